"""Damage a JSON file as a torn disk, a later version or a hand would."""

import json

from hypothesis import strategies as st

OTHER_TYPES = (None, True, [], {}, "x", [1, 2], -1.5, "nan", float("nan"), float("inf"))
WAYS = ("drop", "rename", "type", "repeat", "cut", "zeros")


def places(content):
    """Every container of a JSON value, with each of its keys, the outermost first."""
    found, level = [], [content]
    while level:
        inner = []
        for container in level:
            for key in container if isinstance(container, dict) else range(len(container)):
                found.append((container, key))
                if isinstance(container[key], dict | list):
                    inner.append(container[key])
        level = inner
    return found


@st.composite
def damages(draw):
    """A function that damages the text of a JSON file.

    Keys near the top are drawn as often as the many below.
    """
    way, other = draw(st.sampled_from(WAYS)), draw(st.sampled_from(OTHER_TYPES))
    share, near = draw(st.floats(0, 0.999)), draw(st.booleans())

    def damage(text):
        if way == "cut":
            return text[: int(share * len(text.rstrip()))]
        if way == "zeros":
            start = int(share * len(text))
            return text[:start] + "\0" * (len(text) - start)
        content = json.loads(text)
        every = places(content)
        container, key = every[int(share * (min(30, len(every)) if near else len(every)))]
        value = container[key]
        if way == "type":
            container[key] = other if type(other) is not type(value) else [value]
        elif way == "repeat" and isinstance(container, dict):
            del container[key]
            container["repeated"] = value
            twice = f"{json.dumps(key)}: {json.dumps(other)}, {json.dumps(key)}:"
            return json.dumps(content).replace('"repeated":', twice)
        else:
            del container[key]
            if way == "rename" and isinstance(container, dict):
                container[f"{key}_"] = value
        return json.dumps(content)

    damage.__name__ = f"{way} at {share:.3f}, {other!r}, near={near}"
    return damage
