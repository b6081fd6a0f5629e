"""This module builds Mini 3 Pro, Mini 2 and Tello; how an airframe is built is told in `airframes`."""

import numpy as np

from dronekeypp.sixdronesyn.drone import Drone
from dronekeypp.sixdronesyn.fittings import (
    BLACK,
    GREEN,
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
from dronekeypp.sixdronesyn.shapes import Part, beam, block, hull, lathe, moved, painted

Sides = tuple[list[Part], list[Part]]


def _pitched(angle: float) -> np.ndarray:
    """Return the rotation (3, 3) body←hull of a hull whose nose points up by `angle` radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])


def mini3(drone: Drone, front: np.ndarray, rear: np.ndarray) -> Sides:
    """Build Mini3, which has a smooth rounded hull and a camera as tall as the nose.

    The hull is pitched against the propellers (`hull_pitch`): motors and camera stand upright in the body
    frame, the rest is built level and then turned. The front arms hang from the bottom of the hull, swing
    forward and stand on legs. The rear arms rise from the flanks of the tail. Eyes sit at the corners of the
    brow and on the tail.
    """
    grey, dark = drone.hull_rgb, drone.trim_rgb
    turn = _pitched(drone.hull_pitch)
    stations = [
        (-70, 17, -4, 5, 11, 2.8, 2.8),
        (-68, 22, -10, 5, 14, 2.8, 2.8),
        (-50, 25, -19, 5, 19, 3.2, 2.8),
        (-30, 26.5, -22, 5, 21.5, 3.4, 2.8),
        (-14, 28.5, -23, 4, 26, 3.6, 2.8),
        (8, 31, -22, 4, 29.5, 3.6, 2.8),
        (30, 31, -17, 5, 29, 3.4, 2.8),
        (46, 29.5, -8, 8, 26.5, 3, 2.8),
        (58, 27, 6, 13, 22.5, 2.8, 3.4),
        (63, 23, 10, 14.5, 19.5, 2.6, 2.8),
    ]
    body = hull(stations, grey, rings=26)
    body = painted(body, shade(grey, 0.74), z=(-40, -13))
    body = painted(body, dark, x=(-46, -8), y=(-11, 11), z=(-40, -15))
    body = painted(body, dark, x=(-74, -66.5), z=(-8, 13))
    body = painted(body, dark, x=(-40.6, -39.6), z=(-13, 40))
    body = painted(body, shade(grey, 0.9), x=(-39.6, 24), y=(-14, 14), z=(17, 40))
    body = painted(body, dark, x=(38, 64), y=(-9, 9), z=(20.5, 24))
    at = turn @ (65.0, 0.0, -4.0)
    camera = gimbal(at, (12, 16.5, 16), at[2] + 14, shade(grey, 0.88), shade(grey, 0.62), [(0, 0, 10)])
    cheek = beam([(30, 25, -7), (50, 25, -5), (61, 22, 9)], [(4.5, 12), (3.8, 10), (2.6, 5)], grey, along=6)
    hull_left = [cheek]
    hull_left += eye(body, (46, 15, 15), (0.75, 0.62, 0.32), 6.0)
    hull_left += eye(body, (-48, 10, 10), (-0.75, 0.45, 0.62), 4.8)
    hull_left += eye(body, (14, 9, 0), (0, 0, -1), 4.0)
    hull_left.append(block((17, 30.6, 3), (15, 1.2, 1.6), dark, around=8))
    hull_left += [
        hinge((34, 24, -11), 9, 17, shade(grey, 0.95)),
        hinge((-42, 21, 2), 9, 18, shade(grey, 0.95)),
    ]
    # where the arms meet the motors, in the hull's axes
    front_seat = turn.T @ (front - (0, 0, 14))
    rear_seat = turn.T @ (rear - (0, 0, 15))
    sizes = [(9, 6), (7, 5), (6, 4.6)]
    hull_left.append(arm((34, 25, -13), front_seat, 0, sizes, grey, (0.45, 0.5, 0.4)))
    hull_left.append(arm((-42, 22, 1), rear_seat, 0, sizes, grey, (0.45, 0.5, 0.4)))
    hull_left.append(leg(front_seat, 2, (-31, 1, 1), (6.5, 4.5), 3.2, grey))
    hull_left.append(skid((-54, -22), 15, -12, -30.5, 3, shade(grey, 0.8)))
    middle = [moved(body, turn), *camera]
    left = [moved(part, turn) for part in hull_left]
    left += motor(front, 10.5, 12, grey) + motor(rear, 10.5, 13, grey)
    left.append(light(rear, 10.5, 15, GREEN))
    return middle, left


def mini2(drone: Drone, front: np.ndarray, rear: np.ndarray) -> Sides:
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


def tello(drone: Drone, front: np.ndarray, rear: np.ndarray) -> Sides:
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
