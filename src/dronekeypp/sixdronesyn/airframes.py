"""This module says what each of the seven drones is made of.

The parts are the hull, arms, motors, legs, eyes, gimbal camera and lights. Lengths are millimetres in the
body frame. Sizes come from `drones.py`, and the arms have their true sweep and height. What is not a
published figure there is modelled on how the drone looks and is an estimate.

Each `_name(drone, front, rear)` returns the parts on the middle plane and the parts to its left; `parts`
mirrors the left ones. `front` and `rear` are the left hubs. The columns of each table `stations` are those
of `shapes.hull`: x, half width, z bottom, z widest, z top, exponent bottom, exponent top. A `cheek` is
the edge of the hull beside the gimbal camera.
"""

import numpy as np

from dronekeypp.sixdronesyn import first_airframes
from dronekeypp.sixdronesyn.drone import Drone
from dronekeypp.sixdronesyn.fittings import (
    BLACK,
    GREEN,
    RED,
    WHITE,
    arm,
    eye,
    gimbal,
    hinge,
    leg,
    lens,
    light,
    motor,
    shade,
    skid,
)
from dronekeypp.sixdronesyn.shapes import Part, beam, block, hull, lathe, mirrored, painted

Sides = tuple[list[Part], list[Part]]


def _mini3(drone: Drone, front: np.ndarray, rear: np.ndarray) -> Sides:
    """Build Mini3, which has a smooth rounded hull and a camera as tall as the nose.

    Eyes sit at the corners of the brow and on the tail. The front arms hang low.
    """
    grey, dark = drone.hull_rgb, drone.trim_rgb
    stations = [
        (-76, 17, -4, 6, 12, 2.8, 2.8),
        (-74, 23, -10, 6, 16.5, 2.8, 2.8),
        (-54, 28.5, -20, 5, 21.5, 3.2, 2.8),
        (-12, 30.5, -23, 4, 28.5, 3.6, 2.8),
        (20, 31.5, -21, 4, 29.5, 3.4, 2.8),
        (42, 30, -10, 7, 27, 3, 2.8),
        (55, 27, 6, 13, 22.5, 2.8, 3.4),
        (61, 23, 10, 14.5, 19.5, 2.6, 2.8),
    ]
    body = hull(stations, grey)
    body = painted(body, shade(grey, 0.74), z=(-40, -13))
    body = painted(body, dark, x=(-50, -12), y=(-11, 11), z=(-40, -15))
    body = painted(body, dark, x=(-80, -72.5), z=(-8, 15))
    body = painted(body, dark, x=(-46.6, -45.6), z=(-13, 40))
    body = painted(body, shade(grey, 0.9), x=(-45.6, 20), y=(-14, 14), z=(20, 40))
    body = painted(body, dark, x=(35, 62), y=(-9, 9), z=(21, 24.3))
    camera = gimbal((64, 0, -5), (12, 16.5, 16), 9, shade(grey, 0.88), shade(grey, 0.62), [(0, 0, 10)])
    middle = [body, *camera]
    cheek = beam([(28, 25, -7), (48, 25, -5), (60, 22, 9)], [(4.5, 12), (3.8, 10), (2.6, 5)], grey, along=6)
    left = [cheek]
    left += eye(body, (44, 15, 15), (0.75, 0.62, 0.32), 6.0)
    left += eye(body, (-52, 10, 12), (-0.75, 0.45, 0.62), 4.8)
    left += eye(body, (14, 9, 0), (0, 0, -1), 4.0)
    left.append(block((5, 30.8, 2), (22, 1.2, 1.6), dark, around=8))
    left += [hinge((32, 25, -11), 9, 17, shade(grey, 0.95)), hinge((-44, 24, 4), 9, 17, shade(grey, 0.95))]
    left.append(arm((32, 25, -13), front, 14, [(9.5, 6), (7.5, 5), (6.5, 4.6)], grey, (0.45, 0.5, 0.75)))
    left.append(arm((-44, 24, 2), rear, 14, [(9.5, 6), (7.5, 5), (6.5, 4.6)], grey, (0.45, 0.5, 0.4)))
    left += motor(front, 12.5, 12, grey) + motor(rear, 12.5, 12, grey)
    left.append(leg(front, 16, (-31.5, 3, 1), (7, 4.5), 3.2, grey))
    left.append(skid((-58, -26), 15, -12, -29.5, 3, shade(grey, 0.8)))
    left.append(light(rear, 12.5, 15, GREEN))
    return middle, left


def _mini2(drone: Drone, front: np.ndarray, rear: np.ndarray) -> Sides:
    """Build Mini2, which has a light hull with flat sides and a small ball of a camera.

    It has no eyes in front but two intakes in the brow. The front arms sit high and stand on thin legs, and
    the rear arms sit low.
    """
    grey, dark = drone.hull_rgb, drone.trim_rgb
    stations = [
        (-74, 18, -13, -4, 7, 4, 4),
        (-71.5, 23, -19, -4, 12, 4, 4),
        (-50, 26.5, -23, -2, 16.5, 4.4, 3.8),
        (-5, 28, -22, 0, 20, 4.4, 3.6),
        (24, 29, -19, 2, 21, 4, 3.4),
        (44, 28, -6, 5, 19.5, 3.4, 3.2),
        (61, 24.5, 1, 7.5, 15, 3, 3.4),
        (67, 19, 4, 8.5, 12, 2.6, 2.8),
    ]
    body = hull(stations, grey)
    body = painted(body, shade(grey, 0.74), z=(-40, -14))
    body = painted(body, dark, x=(-58, -22), y=(-12, 12), z=(-40, -15))
    body = painted(body, shade(dark, 0.8), x=(-80, -70.5), z=(-16, 8))
    body = painted(body, dark, x=(-52, -51), z=(-14, 40))
    for edge in (-14.5, 14.5):
        body = painted(body, shade(grey, 0.66), x=(-51, 40), y=(edge - 0.6, edge + 0.6), z=(8, 40))
    body = painted(body, dark, x=(50, 70), y=(-18, -8), z=(7.5, 11.2))
    body = painted(body, dark, x=(50, 70), y=(8, 18), z=(7.5, 11.2))
    camera = gimbal((58, 0, -9), (9.5, 11, 10.5), 4, shade(grey, 0.95), shade(grey, 0.72), [(0, 0, 7.4)])
    middle = [body, *camera, block((67, 0, 6.2), (1.6, 5, 1.0), WHITE, around=10)]
    cheek = beam([(24, 25, -9), (44, 23.5, -7), (58, 21, 2)], [(3.8, 9), (3.2, 8), (2.2, 4)], grey, along=6)
    left = [cheek]
    left += eye(body, (6, 8, 0), (0, 0, -1), 3.8)
    left.append(block((-8, 27.6, 4), (24, 1.0, 1.4), dark, around=8))
    left += [hinge((36, 24, 9), 8.5, 19, shade(grey, 0.95)), hinge((-42, 22, -10), 8.5, 17, shade(grey, 0.9))]
    left.append(arm((36, 24, 9), front, 14.5, [(8.5, 6), (6.5, 4.8), (5.8, 4.4)], grey, (0.45, 0.5, 0.55)))
    left.append(arm((-42, 22, -12), rear, 14, [(8.5, 5.6), (6.5, 4.6), (5.8, 4.4)], grey, (0.45, 0.5, 0.5)))
    left += motor(front, 11.5, 12, grey) + motor(rear, 11.5, 12, grey)
    left.append(leg(front, 16, (-29.5, 5, 2), (6.5, 4.5), 3.0, grey))
    left.append(leg(rear, 15, (-29.5, -3, 0), (6, 3.5), 2.8, grey))
    return middle, left


def _air3(drone: Drone, front: np.ndarray, rear: np.ndarray) -> Sides:
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


def _air2(drone: Drone, front: np.ndarray, rear: np.ndarray) -> Sides:
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


def _mav2(drone: Drone, front: np.ndarray, rear: np.ndarray) -> Sides:
    """Build Mav2, which has a long dark body with the battery let into its back.

    Eyes sit on the narrow nose and one on each flank. The square Hasselblad camera hangs in front.
    """
    grey, dark = drone.hull_rgb, drone.trim_rgb
    stations = [
        (-110, 23, -14, 4, 17, 4.4, 4.4),
        (-107, 30, -24, 4, 21.5, 4.4, 4.4),
        (-78, 35, -33, 4, 24.5, 4.4, 4),
        (-20, 37, -36, 6, 39, 4.4, 4),
        (30, 38, -34, 6, 38, 4, 3.6),
        (58, 34, -20, 7, 33, 3.6, 3.2),
        (82, 29, -4, 9, 25, 3.2, 3.2),
        (95, 23, 1, 10, 19, 2.8, 2.8),
    ]
    body = hull(stations, grey)
    body = painted(body, dark, z=(-60, -22))
    body = painted(body, shade(dark, 1.8), x=(-85, -30), y=(-10, 10), z=(-60, -26))
    body = painted(body, shade(grey, 1.55), x=(30, 96), z=(12.6, 14))
    body = painted(body, dark, x=(70, 97), y=(-26, 26), z=(3, 12.6))
    body = painted(body, dark, x=(28, 60), y=(18, 26), z=(20, 60))
    body = painted(body, dark, x=(28, 60), y=(-26, -18), z=(20, 60))
    stations = [
        (-110.5, 15, 6, 12, 17, 4, 4),
        (-108, 20, 4, 12, 22.5, 4, 4),
        (-80, 24.5, 8, 14, 25.6, 4, 3.2),
        (-26, 26.5, 10, 26, 41, 4, 3.4),
        (14, 25, 10, 28, 41, 4, 3.6),
        (20, 21, 12, 28, 38, 4, 3.6),
    ]
    battery = hull(stations, shade(grey, 0.82), rings=16, around=18)
    battery = painted(battery, dark, x=(-54, -52.5))
    yoke, face, lenses = shade(grey, 0.9), (34, 35, 37), [(0, 0, 14.5)]
    camera = gimbal((90, 0, -17), (15, 19, 19), 4, (60, 61, 63), yoke, lenses, face, hood=True)
    button = lathe([(5, 0), (5, 0.8), (3.6, 1.0)], WHITE, (-72, 0, 27.4), (-0.22, 0, 1))
    badge = block((90, -19.3, -17), (4, 0.5, 3), (176, 138, 74), around=10)
    middle = [body, battery, *camera, button, badge]
    cheek = beam([(46, 31, -8), (70, 27, -8), (90, 24, 4)], [(4.5, 13), (3.8, 9), (2.8, 5)], grey, along=6)
    left = [cheek]
    left += eye(body, (75, 16, 8), (1, 0.08, 0.0), 5.6, dark)
    left += eye(body, (-90, 14, 2), (-1, 0.1, 0), 6.0)
    left += eye(body, (-12, 10, -6), (0, 1, 0), 5.0)
    left += eye(body, (20, 11, 0), (0, 0, -1), 5.0)
    left.append(block((-40, 36, 10), (22, 1.4, 2.4), dark, around=8))
    left.append(block((8, 37, 12), (14, 1.4, 4.5), dark, around=8))
    left.append(skid((-90, -44), 16, -20, -41.5, 4, dark))
    left += [hinge((52, 31, 13), 12, 28, shade(grey, 0.92)), hinge((-66, 31, -14), 12, 26, shade(grey, 0.85))]
    left.append(arm((52, 31, 13), front, 20, [(12, 9), (9.5, 7.2), (8, 6.3)], grey, (0.46, 0.5, 0.55)))
    left.append(arm((-66, 31, -16), rear, 18, [(12, 8.5), (9.5, 7), (8, 6)], grey, (0.48, 0.5, 0.5)))
    left += motor(front, 14, 16, grey) + motor(rear, 14, 16, grey)
    left.append(leg(front, 20, (-42, 10, 2), (10, 6), 4.0, grey))
    left += [light(front, 14, 19, RED), light(rear, 14, 19, GREEN)]
    return middle, left


def _mav3(drone: Drone, front: np.ndarray, rear: np.ndarray) -> Sides:
    """Build Mav3, which is the largest and grey, and whose whole tail is the battery.

    Eyes sit on all corners. The tall camera has a small lens above a large one.
    """
    grey, dark = drone.hull_rgb, drone.trim_rgb
    stations = [
        (-118, 26, -16, 5, 20, 3.4, 3.4),
        (-114.5, 35, -28, 5, 26, 3.4, 3.4),
        (-84, 40.5, -40, 5, 31, 4, 3),
        (-18, 43, -44, 6, 52, 4, 3),
        (32, 44, -40, 8, 51.5, 3.6, 3),
        (62, 42, -16, 12, 46, 3.2, 2.8),
        (84, 37, 6, 20, 39, 3, 3.2),
        (94, 31, 12, 23, 34, 2.6, 2.8),
    ]
    body = hull(stations, grey)
    body = painted(body, dark, z=(-60, -26))
    body = painted(body, shade(dark, 1.7), x=(-90, -30), y=(-13, 13), z=(-60, -32))
    body = painted(body, shade(grey, 0.6), x=(-119, -64))
    body = painted(body, shade(grey, 0.5), x=(-30, -28.6), z=(10, 60))
    for edge in (-24.0, 24.0):
        body = painted(body, shade(grey, 0.5), x=(-64, 70), y=(edge - 0.8, edge + 0.8), z=(30, 60))
    body = painted(body, dark, x=(50, 97), y=(-15, 15), z=(37, 42))
    yoke, face, lenses = shade(grey, 0.9), (38, 39, 41), [(5, 18, 7.0), (0, -8, 15.0)]
    camera = gimbal((101, 0, -3), (16, 21, 30), 20, (72, 73, 76), yoke, lenses, face)
    button = lathe([(8, -2), (8, 1), (6, 1.3)], (206, 208, 210), (-117.6, 0, 4), (-1, 0, 0))
    middle = [body, *camera, button]
    cheek = beam([(46, 36, -8), (70, 34, -5), (90, 30, 16)], [(5, 18), (4.6, 15), (3, 7)], grey, along=6)
    left = [cheek]
    left += eye(body, (66, 21, 26), (0.75, 0.62, 0.25), 9.0)
    left += eye(body, (-92, 18, 12), (-0.65, 0.66, 0.4), 7.5)
    left += eye(body, (22, 14, 0), (0, 0, -1), 5.5)
    left.append(block((0, 42.2, 12), (34, 1.6, 3.0), dark, around=8))
    left.append(skid((-98, -44), 20, -26, -52.5, 4.6, dark))
    left += [
        hinge((54, 36, 19), 13.5, 32, shade(grey, 0.92)),
        hinge((-72, 34, -16), 13, 28, shade(grey, 0.85)),
    ]
    left.append(arm((54, 36, 20), front, 21.5, [(14, 11), (10.5, 8.5), (9, 7)], grey, (0.46, 0.5, 0.5)))
    left.append(arm((-72, 34, -18), rear, 21, [(13, 9.5), (10.5, 7.8), (9, 6.6)], grey, (0.48, 0.5, 0.5)))
    left += motor(front, 16.5, 18, grey) + motor(rear, 16.5, 18, grey)
    left.append(leg(front, 23, (-53.8, 14, 3), (12, 7), 4.4, grey))
    left += [light(front, 16.5, 21, RED), light(rear, 16.5, 21, GREEN)]
    return middle, left


def _tello(drone: Drone, front: np.ndarray, rear: np.ndarray) -> Sides:
    """Build Tello, which has a white lid on a black frame.

    Four thin fixed arms carry motors as slim as pencils. The camera is a dark dot in the nose.
    """
    white, dark = drone.hull_rgb, drone.trim_rgb
    stations = [
        (-47, 12, -9, -2, 4, 4, 3),
        (-45, 15, -12.5, -2, 6, 4, 3),
        (-20, 17.5, -14.5, -2, 8, 4.4, 3),
        (20, 17.5, -14.5, -2, 8, 4.4, 3),
        (38, 15, -12, -1, 6, 4, 3),
        (46, 11, -8, 0, 5, 3, 2.6),
    ]
    lower = hull(stations, dark, rings=16, around=18)
    lower = painted(lower, (96, 97, 100), x=(16, 30), y=(-6, 6), z=(-20, -11))
    stations = [
        (-42, 11, 2, 4, 7.5, 4, 3),
        (-40, 15, 0, 4, 10.5, 4, 3),
        (-24, 18.5, -1, 4, 15.5, 4, 3),
        (-9, 19, -1.5, 4, 19, 4, 3),
        (9, 19, -1.5, 4, 19, 4, 3),
        (28, 17.5, -3, 3, 14.5, 3.6, 2.8),
        (43, 13.5, -7, 1, 8.5, 3, 2.8),
        (48.5, 9.5, -5, 1, 6, 2.6, 2.6),
    ]
    cover = hull(stations, white, rings=22, around=24, gloss=0.5)
    cover = painted(cover, shade(white, 0.7), x=(-24, -23.2))
    cover = painted(cover, shade(white, 0.82), x=(-10, 10), y=(-4, 4), z=(10, 30))
    cover = painted(cover, dark, x=(40, 60), y=(-8, 8), z=(-8, 4))
    camera = lens((49.2, 0, -1.5), 4.4, 6)
    tail = block((-45.5, 0, -3), (2.2, 9, 4.6), shade(white, 0.6))
    middle = [lower, cover, *camera, tail]
    left = [block((47.4, 5.6, -0.6), (1.4, 1.0, 1.0), (110, 230, 120), around=8)]
    nut = [(0, -0.6), (1.6, -0.6), (1.9, -2.6), (1.0, -2.8), (1.0, -4.4)]
    pencil = [(4.0, -4.6), (4.0, -8), (5, -8.4), (5, -22), (3.6, -26)]
    leg_sizes = [(1.8, 3.6), (1.2, 1.8)]
    for hub, root in ((front, (16, 12, -1)), (rear, (-16, 12, -1))):
        left.append(arm(root, hub, 16.5, [(3.8, 4.2), (2.4, 2.9), (2.0, 2.6)], dark, (0.5, 0.55, 0.5)))
        left.append(lathe(nut + pencil, BLACK, hub, segments=14))
        path = [hub - (0, 0, 22), hub - (0, 0, 37.2)]
        left.append(beam(path, leg_sizes, dark, up=(1, 0, 0), along=4, around=8))
    return middle, left


_BUILDERS = {
    "Mini3": _mini3,
    "Mini2": _mini2,
    "Air3": _air3,
    "Air2": _air2,
    "Mav2": _mav2,
    "Mav3": _mav3,
    "Tello": _tello,
}


def parts(drone: Drone) -> list[Part]:
    """Return all opaque parts of one of the seven drones, left and right."""
    builders = first_airframes.BUILDERS if drone.edition == 1 else _BUILDERS
    front, rear = drone.hubs[0] * 1000.0, drone.hubs[3] * 1000.0
    middle, left = builders[drone.name](drone, front, rear)
    right = [mirrored(part) for part in left]
    return middle + left + right
