"""This module builds Air 3, Mavic Air 2, Mavic 2 Pro and Mavic 3.

How an airframe is built is told in `airframes`.
"""

import numpy as np

from dronekeypp.sixdronesyn.drone import Drone
from dronekeypp.sixdronesyn.fittings import (
    GREEN,
    RED,
    WHITE,
    arm,
    eye,
    gimbal,
    hinge,
    leg,
    light,
    motor,
    shade,
    skid,
)
from dronekeypp.sixdronesyn.shapes import RGB, Part, beam, block, hull, lathe, painted

Sides = tuple[list[Part], list[Part]]


def air3(drone: Drone, front: np.ndarray, rear: np.ndarray) -> Sides:
    """Build Air3, which is mid grey, with wide front arms on long legs.

    Big eyes sit on the front and rear corners. The camera has two equal lenses, one above the other.
    """
    grey, dark = drone.hull_rgb, drone.trim_rgb
    stations = [
        (-108, 24, -14, 5, 19, 3.2, 3.2),
        (-105, 32, -26, 5, 25, 3.2, 3.2),
        (-74, 37.5, -38, 5, 32.5, 3.8, 2.8),
        (-18, 40, -42, 6, 46, 3.8, 2.8),
        (28, 41, -38, 8, 45, 3.4, 2.8),
        (56, 40, -14, 12, 41.5, 3, 2.8),
        (76, 36, 10, 20, 36, 2.8, 3.2),
        (84, 30, 15, 22, 31, 2.6, 2.8),
    ]
    body = hull(stations, grey)
    body = painted(body, dark, z=(-60, -24))
    body = painted(body, shade(dark, 1.7), x=(-80, -25), y=(-12, 12), z=(-60, -30))
    body = painted(body, dark, x=(-110, -101), z=(-19, 19))
    body = painted(body, shade(grey, 0.45), x=(-62, -60.6), z=(-24, 60))
    body = painted(body, shade(grey, 0.82), x=(-60.6, 30), y=(-19, 19), z=(30, 60))
    body = painted(body, dark, x=(45, 90), y=(-13, 13), z=(33, 38))
    lenses = [(0, 12, 9.5), (0, -11.5, 10.5)]
    camera = gimbal((88, 0, -4), (15, 17, 26), 16, shade(dark, 1.1), shade(grey, 0.85), lenses)
    middle = [body, *camera]
    cheek = beam([(40, 34, -8), (62, 33, -4), (80, 29, 14)], [(5, 18), (4.4, 15), (3, 7)], grey, along=6)
    left = [cheek]
    left += eye(body, (58, 20, 22), (0.75, 0.62, 0.3), 9.5)
    left += eye(body, (-84, 16, 12), (-0.72, 0.5, 0.5), 7.5)
    left += eye(body, (22, 13, 0), (0, 0, -1), 5.5)
    left.append(block((-8, 39.4, 10), (32, 1.4, 3.0), dark, around=8))
    left.append(skid((-86, -38), 20, -24, -51.5, 4.4, dark))
    left.append(block((-107.4, 9, 6), (1.6, 4, 1.4), WHITE, around=8))
    left += [
        hinge((50, 34, 15), 13, 30, shade(grey, 0.92)),
        hinge((-62, 32, -16), 12.5, 26, shade(grey, 0.85)),
    ]
    left.append(arm((50, 34, 16), front, 20.5, [(13, 10), (10, 8), (8.5, 7)], grey, (0.42, 0.5, 0.5)))
    left.append(arm((-62, 32, -18), rear, 20, [(13, 9), (10, 7.5), (8.5, 6.5)], grey, (0.45, 0.5, 0.5)))
    left += motor(front, 15.5, 17, grey) + motor(rear, 15.5, 17, grey)
    left.append(leg(front, 22, (-55, 8, 4), (12, 7), 4.2, grey))
    left += [light(front, 15.5, 20, RED), light(rear, 15.5, 20, GREEN)]
    return middle, left


def air2(drone: Drone, front: np.ndarray, rear: np.ndarray) -> Sides:
    """Build Air2, which is dark grey, with a flat battery and its round button on top.

    Two eyes sit in a dark band across the brow, and one camera hangs below it.
    """
    grey, dark = drone.hull_rgb, drone.trim_rgb
    stations = [
        (-94, 23, -12, 3, 15, 4, 4),
        (-91.5, 29, -22, 3, 20, 4, 4),
        (-66, 32.5, -31, 3, 24, 4.2, 4),
        (-14, 35, -34, 3, 34.5, 4.2, 3.6),
        (24, 37, -30, 4, 37.5, 3.8, 3.4),
        (50, 36, -11, 8, 33, 3.4, 3.2),
        (70, 32, 3, 13, 27.5, 3, 3.4),
        (77, 27, 7, 14.5, 23.5, 2.8, 3),
    ]
    body = hull(stations, grey)
    body = painted(body, dark, z=(-50, -20))
    body = painted(body, shade(dark, 1.9), x=(-70, -25), y=(-10, 10), z=(-60, -25))
    body = painted(body, dark, x=(62, 90), y=(-30, 30), z=(10, 22))
    body = painted(body, dark, x=(-2, -0.8), z=(5, 50))
    body = painted(body, dark, x=(-95, -2), z=(5, 6.3))
    body = painted(body, shade(grey, 0.8), x=(-95, -2), y=(-20, 20), z=(20, 50))
    body = painted(body, dark, x=(-95, -89), y=(-18, 18), z=(-14, 3))
    camera = gimbal((76, 0, -8), (13, 15, 14.5), 9, shade(grey, 0.7), shade(grey, 0.9), [(0, 0, 10.5)])
    button = lathe([(6, 0), (6, 0.8), (4.6, 1.0)], shade(grey, 1.5), (-62, 0, 24.6), (-0.2, 0, 1))
    middle = [body, *camera, button]
    cheek = beam([(36, 31, -8), (54, 30, -5), (71, 27, 8)], [(4.5, 14), (4, 11.5), (2.8, 6)], grey, along=6)
    left = [cheek]
    left += eye(body, (56, 19, 16), (1, 0.08, 0.02), 5.4, dark)
    left += eye(body, (-80, 12, 10), (-1, 0.1, 0.0), 5.0)
    left += eye(body, (18, 11, 0), (0, 0, -1), 5.0)
    left.append(block((-10, 34.6, -4), (30, 1.2, 2.4), dark, around=8))
    left.append(skid((-76, -38), 16, -18, -37.8, 3.8, dark))
    left += [
        hinge((44, 31, 12), 11.5, 26, shade(grey, 0.9)),
        hinge((-56, 28, -13), 11.5, 22, shade(grey, 0.85)),
    ]
    left.append(arm((44, 31, 12), front, 18.5, [(11.5, 8.5), (9.5, 7), (8, 6)], grey, (0.42, 0.5, 0.55)))
    left.append(arm((-56, 28, -15), rear, 17, [(11.5, 8), (9.5, 6.5), (8, 5.8)], grey, (0.45, 0.5, 0.5)))
    left += motor(front, 14, 15, grey) + motor(rear, 14, 15, grey)
    left.append(leg(front, 19, (-38.5, 6, 3), (10, 6), 3.8, grey))
    left += [light(front, 14, 18, RED), light(rear, 14, 18, GREEN)]
    return middle, left


def _housing(hub: np.ndarray, radius: float, top: float, bottom: float, rgb: RGB) -> Part:
    """Build the round end of an arm that carries a motor, from `top` to `bottom` below the hub (3,)."""
    r = radius
    profile = [(0.0, -top), (r, -top - 1), (r, 4 - bottom), (0.8 * r, -bottom), (0.0, -bottom)]
    return lathe(profile, rgb, hub, segments=14)


def mav2(drone: Drone, front: np.ndarray, rear: np.ndarray) -> Sides:
    """Build Mav2, which has a long narrow dark hull with broad shoulders, and a keel below it.

    The front arms leave the shoulders, swing forward and stand on legs. The rear arms leave the bottom of
    the tail, swing backward past its end and stand on short feet. Eyes sit on the nose, the tail and the
    flanks. The square Hasselblad camera hangs below the nose, in front of the keel.
    """
    grey, dark = drone.hull_rgb, drone.trim_rgb
    stations = [
        (-77, 15, -12, 0, 8, 4, 3),
        (-74, 20, -19, 0, 15, 4, 3),
        (-58, 26, -22, 2, 29, 4, 3),
        (-24, 30, -20, 4, 35, 4, 3.4),
        (28, 31, -14, 8, 36.5, 4, 3.6),
        (52, 39, -2, 16, 37, 3.4, 3.6),
        (80, 41, 4, 19, 36, 3.4, 3.8),
        (108, 37, 7, 18, 32, 3.4, 4),
        (121, 33, 10, 18, 28, 3.2, 4),
        (125, 28, 13, 18, 24, 2.8, 3),
    ]
    body = hull(stations, grey, rings=28)
    body = painted(body, shade(grey, 1.5), x=(24, 126), z=(17.4, 18.6))
    body = painted(body, dark, x=(114, 127), y=(-29, 29), z=(10, 17.4))
    body = painted(body, dark, x=(-54, -52.5), z=(-4, 60))
    body = painted(body, shade(grey, 0.82), x=(-78, 20), y=(-22, 22), z=(8, 60))
    stations = [
        (-70, 17, -21, -10, 0, 5, 4),
        (-66, 22, -26, -10, 2, 5, 4),
        (-30, 27, -28, -8, 6, 5, 4),
        (40, 28, -27, -4, 12, 5, 4),
        (74, 27, -24, -2, 14, 5, 4),
        (80, 24, -18, -2, 14, 5, 4),
    ]
    keel = hull(stations, dark, rings=16, around=18)
    keel = painted(keel, shade(dark, 1.8), x=(-50, 10), y=(-11, 11), z=(-60, -24))
    yoke, face, lenses = shade(grey, 0.9), (34, 35, 37), [(0, 0, 13.5)]
    camera = gimbal((102, 0, -9), (13.5, 17, 16.5), 10, (60, 61, 63), yoke, lenses, face, hood=True)
    button = lathe([(5, -1), (5, 0.8), (3.6, 1.0)], WHITE, (-12, 0, 35.4))
    badge = block((103, -17.3, -9), (4, 0.5, 3), (176, 138, 74), around=10)
    middle = [body, keel, *camera, button, badge]
    left = eye(body, (100, 22, 14), (1, 0.06, 0.0), 5.6, dark)
    left += eye(body, (-60, 11, 0), (-1, 0.1, 0), 5.4)
    left += eye(keel, (0, 10, -6), (0, 1, 0), 5.0)
    left += eye(keel, (56, 12, 0), (0, 0, -1), 5.0)
    left.append(block((-20, 29.4, 6), (16, 1.4, 2.4), dark, around=8))
    left += [hinge((64, 36, 22), 11, 26, shade(grey, 0.92)), hinge((-58, 23, -8), 10, 25, shade(grey, 0.85))]
    left.append(arm((64, 37, 23), front, 25, [(6.5, 11.5), (6, 9.5), (5.5, 8)], grey, (0.5, 0.5, 0.5)))
    left.append(arm((-58, 25, -8), rear, 30, [(6.5, 10.5), (6, 9), (5.5, 8)], grey, (0.5, 0.5, 0.5)))
    left += motor(front, 14, 14, grey) + motor(rear, 14, 14, grey)
    left += [_housing(front, 13, 16, 35, grey), _housing(rear, 13, 16, 42, grey)]
    left.append(leg(front, 28, (-42, -3, -5), (10, 7), 2.8, grey))
    left.append(leg(rear, 38, (-42, -3, 0), (8, 5), 3.4, dark))
    left += [light(front, 14, 18, RED), light(rear, 14, 18, GREEN)]
    return middle, left


def mav3(drone: Drone, front: np.ndarray, rear: np.ndarray) -> Sides:
    """Build Mav3, which is the largest and grey, and whose whole tail is the battery.

    The front arms leave the shoulders, swing forward and stand on long legs. The rear arms leave the bottom
    of the tail, swing backward past its end and rise to motors as high as those in front. Eyes sit on all
    corners. The tall camera below the brow has a small lens above a large one.
    """
    grey, dark = drone.hull_rgb, drone.trim_rgb
    stations = [
        (-86, 22, -14, 4, 20, 3.4, 3.2),
        (-82, 30, -24, 4, 27, 3.4, 3.2),
        (-58, 36, -33, 5, 36, 4, 3),
        (-14, 38, -37, 6, 45, 4, 3),
        (34, 39, -34, 8, 46, 3.6, 3),
        (70, 42, -22, 12, 45, 3.2, 2.8),
        (98, 39, 4, 20, 41, 3, 3.2),
        (118, 35, 13, 25, 37, 2.8, 3.2),
        (124, 29, 18, 26, 33, 2.6, 2.8),
    ]
    body = hull(stations, grey, rings=28)
    body = painted(body, dark, z=(-60, -22))
    body = painted(body, shade(dark, 1.7), x=(-62, -6), y=(-13, 13), z=(-60, -28))
    body = painted(body, shade(grey, 0.6), x=(-87, -40))
    body = painted(body, shade(grey, 0.5), x=(-8, -6.6), z=(10, 60))
    for edge in (-22.0, 22.0):
        body = painted(body, shade(grey, 0.5), x=(-40, 100), y=(edge - 0.8, edge + 0.8), z=(28, 60))
    body = painted(body, dark, x=(84, 126), y=(-15, 15), z=(33.5, 39))
    yoke, face, lenses = shade(grey, 0.9), (38, 39, 41), [(5, 15, 6.5), (0, -7, 14.0)]
    camera = gimbal((124, 0, 0), (14, 20, 26), 22, (72, 73, 76), yoke, lenses, face)
    button = lathe([(8, -2), (8, 1), (6, 1.3)], (206, 208, 210), (-85.6, 0, 4), (-1, 0, 0))
    middle = [body, *camera, button]
    cheek = beam([(70, 34, -8), (96, 33, -3), (116, 29, 17)], [(5, 17), (4.6, 14), (3, 7)], grey, along=6)
    left = [cheek]
    left += eye(body, (92, 20, 26), (0.75, 0.62, 0.25), 8.5)
    left += eye(body, (-62, 17, 12), (-0.65, 0.66, 0.4), 7.5)
    left += eye(body, (30, 14, 0), (0, 0, -1), 5.5)
    left.append(block((10, 37.6, 14), (30, 1.6, 3.0), dark, around=8))
    left.append(skid((-70, -26), 20, -26, -52.5, 4.6, dark))
    left += [
        hinge((68, 36, 24), 12.5, 34, shade(grey, 0.92)),
        hinge((-62, 31, -14), 12, 30, shade(grey, 0.85)),
    ]
    left.append(arm((68, 37, 25), front, 26, [(8, 13), (7.5, 10.5), (7, 8.5)], grey, (0.5, 0.5, 0.5)))
    left.append(arm((-62, 32, -14), rear, 30, [(8, 11.5), (7.5, 9.5), (7, 8.5)], grey, (0.5, 0.5, 0.42)))
    left += motor(front, 13, 15, grey) + motor(rear, 13, 15, grey)
    left += [_housing(front, 12.2, 17, 37, grey), _housing(rear, 12.2, 17, 44, grey)]
    left.append(leg(front, 30, (-53.8, 4, 1), (11, 7), 3.6, grey))
    left += [light(front, 13, 19, RED), light(rear, 13, 19, GREEN)]
    return middle, left
