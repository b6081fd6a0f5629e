"""What the tests of drone bodies share: which parts hang in the air, and whether a surface is closed."""

from collections.abc import Sequence

import numpy as np

from dronekeypp.sixdronesyn.shapes import Part, as_polydata


def floating(parts: Sequence[Part], gap: float) -> list[int]:
    """Return the parts that no chain of touching parts joins to part 0, by their place in `parts`.

    Two parts touch where their surfaces cross, or where a point of one lies inside the other or within `gap`
    of it, in the unit of the parts.
    """
    surfaces = [as_polydata(part.points, part.faces) for part in parts]
    low = np.array([part.points.min(axis=0) for part in parts])
    high = np.array([part.points.max(axis=0) for part in parts])

    def touch(i: int, j: int) -> bool:
        for a, b in ((i, j), (j, i)):
            distance = surfaces[a].compute_implicit_distance(surfaces[b])["implicit_distance"]
            if distance.min() < gap:
                return True
        # thin parts may cross without a point of either near the other
        return surfaces[i].collision(surfaces[j])[1] > 0

    reached, todo = {0}, [0]
    while todo:
        i = todo.pop()
        apart = np.maximum(low[i] - high, low - high[i]).max(axis=1)  # between the bounding boxes
        for j in set(np.flatnonzero(apart < gap).tolist()) - reached:
            if touch(i, j):
                reached.add(j)
                todo.append(j)
    return [j for j in range(len(parts)) if j not in reached]


def is_closed(part: Part) -> bool:
    """Return whether every edge of a part belongs to two faces that run along it in opposite directions."""
    _, corner = np.unique(np.round(part.points, 6), axis=0, return_inverse=True)
    faces = corner.ravel()[part.faces]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    once = {tuple(edge) for edge in edges.tolist()}
    return len(once) == len(edges) and once == {(b, a) for a, b in once}
