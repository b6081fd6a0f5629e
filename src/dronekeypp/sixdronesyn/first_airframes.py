"""This module builds the three airframes that only the first edition of the data set has.

See `first_edition`; how an airframe is built is told in `airframes`.
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
from dronekeypp.sixdronesyn.shapes import Part, beam, block, hull, lathe, painted

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


BUILDERS = {"Mini3": _mini3, "Mav2": _mav2, "Mav3": _mav3}
