"""Man-made small things, built from lines and little meshes: cars, lamps, fences, power lines, cranes, boats."""

from __future__ import annotations

import numpy as np

from dronekeypp.environments.things import Lines, Mesh

CAR_PAINTS = (
    (0.62, 0.62, 0.61),
    (0.03, 0.03, 0.035),
    (0.30, 0.31, 0.32),
    (0.10, 0.11, 0.12),
    (0.30, 0.025, 0.02),
    (0.03, 0.07, 0.20),
    (0.45, 0.44, 0.41),
)


def _place(points: np.ndarray, x: float, y: float, heading: float) -> np.ndarray:
    """Local (forward, left, up) points to world."""
    points = np.atleast_2d(np.asarray(points, float))
    c, s = np.cos(heading), np.sin(heading)
    out = points.copy()
    out[:, 0], out[:, 1] = x + points[:, 0] * c - points[:, 1] * s, y + points[:, 0] * s + points[:, 1] * c
    return out


def car(x: float, y: float, heading: float, rng: np.random.Generator) -> list[Mesh]:
    """A parked car about 4.4 m long: body and cabin, wheels, glass."""
    paint = CAR_PAINTS[int(rng.integers(len(CAR_PAINTS)))]
    long, tall = rng.uniform(3.9, 4.7), rng.uniform(1.42, 1.62)
    van = rng.random() < 0.25
    hood = 0.95 if not van else 1.1
    body = [
        (-0.5, 0.35),
        (-0.5, 0.82),
        (-0.47, hood - 0.02),
        (0.26, hood),
        (0.46, hood - 0.16),
        (0.5, 0.68),
        (0.5, 0.33),
        (0.3, 0.24),
        (-0.3, 0.24),
    ]
    cabin = [
        (-0.46 if van else -0.42, hood - 0.01),
        (-0.42 if van else -0.29, tall),
        (0.02, tall + 0.02),
        (0.27, hood),
    ]
    dark, glass = (0.02, 0.02, 0.022), (0.015, 0.018, 0.02)
    faces, colours, gloss = [], [], []

    def add(points, colour, shine):
        faces.append(_place(points, x, y, heading))
        colours.append(colour)
        gloss.append(shine)

    def extrude(profile, low, high, side, tops):
        rim = [(a * long, b) for a, b in profile]
        for sign in (-1, 1):
            wide = [low if b < hood + 0.02 else high for _, b in profile]
            add([(a, sign * w, b) for (a, b), w in zip(rim, wide, strict=True)], side, 0.6)
        for i in range(len(rim)):
            (a, b), (c, d) = rim[i], rim[(i + 1) % len(rim)]
            wa, wc = (low if z < hood + 0.02 else high for z in (b, d))
            add([(a, wa, b), (c, wc, d), (c, -wc, d), (a, -wa, b)], tops[i % len(tops)], 0.9)

    extrude(body, 0.86, 0.86, paint, [paint])
    extrude(cabin, 0.84, 0.64, glass, [glass, paint, glass, paint])
    body_mesh = Mesh(faces[:], colours[:], gloss[:])
    faces.clear(), colours.clear(), gloss.clear()
    turn = np.linspace(0, 2 * np.pi, 15)[:-1]
    for ahead in (-0.29, 0.31):
        for sign in (-1, 1):
            add(
                [(ahead * long + 0.31 * np.cos(t), sign * 0.87, 0.31 + 0.31 * np.sin(t)) for t in turn],
                dark,
                0.0,
            )
            add(
                [(ahead * long + 0.18 * np.cos(t), sign * 0.88, 0.31 + 0.18 * np.sin(t)) for t in turn],
                (0.25, 0.25, 0.26),
                0.3,
            )
    for sign in (-1, 1):
        add(
            [
                (0.49 * long, sign * 0.78, 0.72),
                (0.505 * long, sign * 0.45, 0.70),
                (0.505 * long, sign * 0.45, 0.60),
                (0.50 * long, sign * 0.78, 0.60),
            ],
            (0.6,) * 3,
            1,
        )
        add(
            [
                (-0.5 * long - 0.01, sign * 0.8, 0.85),
                (-0.505 * long, sign * 0.6, 0.85),
                (-0.505 * long, sign * 0.6, 0.7),
                (-0.505 * long, sign * 0.8, 0.7),
            ],
            (0.3, 0.01, 0.01),
            1,
        )
    towards = np.array([np.cos(heading), np.sin(heading)]) * -np.array([x, y])
    facing = np.sign(-np.sin(heading) * -x + np.cos(heading) * -y) or 1.0
    front = np.sign(towards.sum()) or 1.0
    seen = [
        i
        for i in range(len(faces))
        if (i < 8 and (1 if (i // 2) % 2 else -1) == facing) or (i >= 8 and ((i - 8) % 2 == 0) == (front > 0))
    ]
    return [
        body_mesh,
        _TwoSided([faces[i] for i in seen], [colours[i] for i in seen], [gloss[i] for i in seen]),
    ]


class _TwoSided(Mesh):
    """Loose polygons lying on a body: a little nearer than it, each drawn whichever way it faces."""

    @property
    def distance(self) -> float:
        return super().distance - 1.2

    def cast(self, shadows) -> None:
        return None

    def paint(self, canvas, light) -> None:
        for face, colour, shine in zip(self.faces, self.colours, self.gloss, strict=True):
            Mesh([face], [colour], [shine]).paint(canvas, light)


def lamp(
    x: float, y: float, heading: float, height: float = 8.0, glow: float = 0.0, ground: float = 0.0
) -> list[Lines]:
    """A street lamp: tapering mast, arm, head."""
    top = np.array([x, y, ground + height])
    arm = top + np.array([np.cos(heading), np.sin(heading), 0.12]) * 1.4
    mast = [
        (np.array([x, y, ground]), (top + [x, y, ground]) / 2),
        ((top + [x, y, ground]) / 2, top),
        (top, arm),
    ]
    bars = Lines(np.array(mast), np.array([0.17, 0.12, 0.07]), (0.30, 0.31, 0.31))
    head = Lines(
        np.array([(arm, arm + np.array([np.cos(heading), np.sin(heading), 0]) * 0.6)]),
        np.array([0.16]),
        (0.35, 0.35, 0.35),
        (glow, glow * 0.8, glow * 0.5),
    )
    return [bars, head]


def fence(start, end, height: float = 1.2, style: str = "posts") -> list[Lines]:
    """posts: wood posts and two rails. mesh: posts and wires. rail: a quay or roof railing."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = float(np.hypot(*(end - start)))
    pitch = {"posts": 2.4, "mesh": 3.0, "rail": 1.6}[style]
    colour = {"posts": (0.17, 0.13, 0.095), "mesh": (0.26, 0.27, 0.27), "rail": (0.30, 0.31, 0.32)}[style]
    thick = {"posts": (0.10, 0.06), "mesh": (0.06, 0.012), "rail": (0.045, 0.035)}[style]
    levels = {"posts": (0.55, 0.92), "mesh": np.linspace(0.06, 1, 9), "rail": (0.35, 0.68, 1.0)}[style]
    count = max(2, int(length / pitch) + 1)
    at = start + (end - start) * np.linspace(0, 1, count)[:, None]
    ends, widths = [], []
    for p in at:
        ends.append(([*p, 0.0], [*p, height]))
        widths.append(thick[0])
    for a, b in zip(at[:-1], at[1:], strict=True):
        for level in levels:
            ends.append(([*a, height * level], [*b, height * level]))
            widths.append(thick[1])
    middle = np.array([np.hypot(*((np.array(e[0]) + np.array(e[1]))[:2] / 2)) for e in ends])
    ends, widths = np.array(ends, float), np.array(widths)
    return [Lines(ends[i : i + 1], widths[i : i + 1], colour) for i in np.argsort(-middle)]


def power_line(
    heading: float,
    offset: float,
    height: float = 9.0,
    pitch: float = 42.0,
    spans: int = 9,
    wires: int = 3,
    ground=None,
) -> list[Lines]:
    """Poles along a line, with sagging wires. ground: function (x, y) -> metres."""
    c, s = np.cos(heading), np.sin(heading)
    out, tops = [], []
    for i in range(-spans, spans + 1):
        along = i * pitch + 11.0
        x, y = along * c - offset * s, along * s + offset * c
        foot = float(ground(np.array([[x]]), np.array([[y]]))[0, 0]) if ground else 0.0
        top = np.array([x, y, foot + height])
        side = np.array([-s, c, 0]) * 0.11 * height
        out.append(
            Lines(
                np.array([([x, y, foot], top), (top - side - [0, 0, 0.6], top + side - [0, 0, 0.6])]),
                np.array([0.03, 0.018]) * height**0.9,
                (0.15, 0.12, 0.10),
            )
        )
        tops.append([top + side * k - [0, 0, 0.45] for k in np.linspace(-1, 1, wires)])
    for a, b in zip(tops[:-1], tops[1:], strict=True):
        for p, q in zip(a, b, strict=True):
            t = np.linspace(0, 1, 13)[:, None]
            line = p + (q - p) * t - np.array([0, 0, 0.03 * pitch]) * 4 * t * (1 - t)
            out.append(Lines(np.stack([line[:-1], line[1:]], 1), np.full(12, 0.018), (0.06, 0.06, 0.06)))
    return out


def pylon(x: float, y: float, heading: float, height: float = 42.0, ground: float = 0.0) -> list[Lines]:
    """A lattice mast."""
    levels = np.linspace(0, 1, 9)
    wide = height * 0.085 * (1 - levels) ** 1.2 + 0.5
    bars = []
    corner = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    for i in range(8):
        for k in range(4):
            a, b = corner[k], corner[(k + 1) % 4]
            low, high = levels[i] * height, levels[i + 1] * height
            bars.append(([*(a * wide[i]), low], [*(a * wide[i + 1]), high]))
            bars.append(([*(a * wide[i]), low], [*(b * wide[i + 1]), high]))
            bars.append(([*(b * wide[i]), low], [*(a * wide[i + 1]), high]))
    for level in (0.66, 0.8, 0.94):
        reach = height * (0.17 - 0.06 * (level - 0.66) / 0.28)
        for sign in (-1, 1):
            bars.append(([0, 0, level * height], [0, sign * reach, level * height]))
            bars.append(([0, 0, (level + 0.05) * height], [0, sign * reach, level * height]))
    ends = np.array([[_place(p, x, y, heading)[0] + [0, 0, ground] for p in bar] for bar in bars])
    return [Lines(ends, np.full(len(ends), 0.13), (0.25, 0.26, 0.26))]


def crane(x: float, y: float, heading: float, height: float = 38.0, colour=(0.42, 0.27, 0.03)) -> list[Lines]:
    """A tower crane: lattice mast and jib."""
    bars, w = [], 0.8
    steps = int(height / 2.2)
    z = np.linspace(0, height, steps + 1)
    for i in range(steps):
        for sx, sy in ((w, w), (-w, w), (-w, -w), (w, -w)):
            bars.append(([sx, sy, z[i]], [sx, sy, z[i + 1]]))
        flip = 1 if i % 2 else -1
        bars += [
            ([w * flip, w, z[i]], [-w * flip, w, z[i + 1]]),
            ([w * flip, -w, z[i]], [-w * flip, -w, z[i + 1]]),
        ]
        bars += [
            ([w, w * flip, z[i]], [w, -w * flip, z[i + 1]]),
            ([-w, w * flip, z[i]], [-w, -w * flip, z[i + 1]]),
        ]
    jib = np.arange(-12, 40.1, 2.0)
    for a, b in zip(jib[:-1], jib[1:], strict=True):
        for sy in (-0.7, 0.7):
            bars += [
                ([a, sy, height], [b, sy, height]),
                ([a, sy, height], [(a + b) / 2, 0, height + 1.6]),
                ([(a + b) / 2, 0, height + 1.6], [b, sy, height]),
            ]
        bars.append(([a, 0, height + 1.6], [b, 0, height + 1.6]))
    apex = [0, 0, height + 7]
    bars += [
        ([0, 0, height], apex),
        (apex, [34, 0, height + 1.6]),
        (apex, [16, 0, height + 1.6]),
        (apex, [-11, 0, height + 1.2]),
    ]
    bars += [([24, 0, height], [24, 0, height * 0.45])]
    ends = np.array([[_place(p, x, y, heading)[0] for p in bar] for bar in bars])
    thick = np.full(len(ends), 0.16)
    thick[-5:] = (0.25, 0.06, 0.06, 0.06, 0.05)
    cabin = np.array(
        [[_place(p, x, y, heading)[0] for p in ([-11.5, 0, height + 0.1], [-8.5, 0, height + 0.1])]]
    )
    return [Lines(ends, thick, colour), Lines(cabin, np.array([2.2]), (0.3, 0.3, 0.29))]


def floodlight(x: float, y: float, height: float = 30.0, glow: float = 0.0) -> list[Lines]:
    towards = np.arctan2(-y, -x)
    side = np.array([-np.sin(towards), np.cos(towards), 0])
    foot, top = np.array([x, y, 0.0]), np.array([x, y, height])
    bars = [
        Lines(
            np.array([(foot, foot + (top - foot) * 0.5), (foot + (top - foot) * 0.5, top + [0, 0, 3])]),
            np.array([0.75, 0.5]),
            (0.35, 0.36, 0.36),
        )
    ]
    rows = [(top + side * -2.6 + [0, 0, k], top + side * 2.6 + [0, 0, k]) for k in (0.2, 1.1, 2.0, 2.9)]
    return bars + [Lines(np.array(rows), np.full(4, 0.6), (0.45, 0.46, 0.47), (glow, glow, glow * 0.9))]


def boat(x: float, y: float, heading: float, rng: np.random.Generator) -> list:
    """A small sailing boat with its mast bare."""
    long = rng.uniform(6.5, 10.5)
    t = np.linspace(-1, 1, 9)
    beam = (
        0.16 * long * np.sqrt(np.clip(1 - np.clip(t, -0.5, 1) ** 2.0 * (t > 0) - 0.25 * (t < 0) * t**2, 0, 1))
    )
    hull, deck = (
        ((0.50, 0.50, 0.49), (0.42, 0.41, 0.38), (0.05, 0.08, 0.16), (0.24, 0.05, 0.04))[
            int(rng.integers(4))
        ],
        (0.40, 0.37, 0.30),
    )
    faces, colours = [], []
    rise = 0.95 + 0.25 * np.maximum(t, 0)
    for sign in (-1, 1):
        for i in range(8):
            a, b = i, i + 1
            faces.append(
                [
                    (t[a] * long / 2, sign * beam[a], rise[a]),
                    (t[b] * long / 2, sign * beam[b], rise[b]),
                    (t[b] * long / 2.15, sign * beam[b] * 0.75, 0),
                    (t[a] * long / 2.15, sign * beam[a] * 0.75, 0),
                ]
            )
            colours.append(hull)
    faces.append(
        [
            (-long / 2, -beam[0], 0.95),
            (-long / 2, beam[0], 0.95),
            (-long / 2.15, beam[0] * 0.75, 0),
            (-long / 2.15, -beam[0] * 0.75, 0),
        ]
    )
    colours.append(hull)
    cabin = [(-0.18 * long, 0.9), (-0.16 * long, 1.55), (0.14 * long, 1.45), (0.2 * long, 1.0)]
    for sign in (-1, 1):
        faces.append([(a, sign * 0.09 * long, b) for a, b in cabin])
        colours.append(deck)
    for (a, b), (c, d) in zip(cabin[:-1], cabin[1:], strict=True):
        faces.append([(a, 0.09 * long, b), (c, 0.09 * long, d), (c, -0.09 * long, d), (a, -0.09 * long, b)])
        colours.append((0.58, 0.58, 0.56))
    mesh = Mesh([_place(f, x, y, heading) for f in faces], colours, [0.3] * len(faces))
    mast = 1.35 * long
    bars = [
        ([0.05 * long, 0, 1.2], [0.05 * long, 0, mast]),
        ([0.05 * long, 0, 2.0], [-0.38 * long, 0, 1.9]),
        ([0.05 * long, 0, mast], [0.5 * long, 0, 1.2]),
    ]
    bars += [
        ([0.05 * long, 0, mast], [-0.5 * long, 0, 1.0]),
        ([0.05 * long, 0, mast * 0.97], [0.04 * long, 0.15 * long, 1.0]),
        ([0.05 * long, 0, mast * 0.97], [0.04 * long, -0.15 * long, 1.0]),
    ]
    ends = np.array([[_place(p, x, y, heading)[0] for p in bar] for bar in bars])
    return [mesh, Lines(ends, np.array([0.11, 0.10, 0.012, 0.012, 0.012, 0.012]), (0.5, 0.5, 0.5))]
