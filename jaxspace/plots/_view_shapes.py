"""Faces of simple bodies for the three-dimensional view: boxes, solids of revolution, wheels."""

from collections.abc import Sequence
from typing import NotRequired, TypedDict

import numpy as np


class Face(TypedDict):
    """A polygon of the view by its corners, (x, y, z) each.

    - `kind`: "face", "mark" for a darker one, or "wheel", which turns by the angle of the `wheel`.
    - `both`: whether it is seen from both sides."""

    points: Sequence[Sequence[float]]
    kind: NotRequired[str]
    wheel: NotRequired[int]
    both: NotRequired[bool]


SIDES = 28
"""Sides of the polygon that represents a circle."""
THINNEST = 0.02
"""Half-thickness of a flat body, or radius of a rod, in units of the half-length."""


def faces_of(moments: np.ndarray, axes: np.ndarray) -> list[Face]:
    """The homogeneous body with these principal moments: a box, or a cylinder where two are equal.

    **Arguments**

    - `moments`: (3,); only their ratios matter.
    - `axes`: the principal axes as columns, in body axes, (3, 3).

    **Returns** faces whose corners are in body axes, in units of the greatest half-length.
    """
    # Mean squares along the axes; rounding makes that of a flat body negative.
    squares = np.maximum(0.5 * np.sum(moments) - moments, 0.0)
    size = np.sqrt(squares)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        if abs(moments[i] - moments[j]) < 1e-6 * moments[i]:
            # m = 1: C = r^2/2, and the square of the half-length is 3 A - 3 C/2.
            radius = np.sqrt(2.0 * moments[k])
            half = np.sqrt(max(3.0 * moments[i] - 1.5 * moments[k], 0.0))
            largest = max(radius, half)
            half, radius = max(half / largest, THINNEST), max(radius / largest, THINNEST)
            profile = [(0.0, -half), (radius, -half), (radius, half)]
            faces = revolved([*profile, (0.0, half)])
            turned = axes[:, [i, j, k]]
            return _moved(faces, turned)
    return _moved(_box(np.maximum(size / np.max(size), THINNEST)), axes)


def top_faces() -> list[Face]:
    """A top on its tip at the origin, along z."""
    profile = [(0.0, 0.0), (0.03, 0.12), (0.06, 0.42), (0.5, 0.6), (0.5, 0.7), (0.06, 0.78)]
    return revolved([*profile, (0.04, 1.0), (0.0, 1.0)])


def wheel_faces(wheel: int, axis: np.ndarray) -> list[Face]:
    """A spoked wheel about an axis through the origin, which the view turns by its angle."""
    towards = axis / np.linalg.norm(axis)
    # With the base axis farthest from it: a near one leaves no digits.
    aside = np.cross(towards, np.eye(3)[np.argmin(np.abs(towards))])
    aside = aside / np.linalg.norm(aside)
    frame = np.stack([aside, np.cross(towards, aside), towards], axis=1)
    rim: list[Face] = revolved(
        [(0.15, -0.03), (0.18, -0.03), (0.18, 0.03), (0.15, 0.03), (0.15, -0.03)]
    )
    spokes: list[Face] = [
        {
            "points": [
                (0.15 * np.cos(a), 0.15 * np.sin(a), 0.0),
                (0.03 * np.cos(a + 1.6), 0.03 * np.sin(a + 1.6), 0.0),
                (0.03 * np.cos(a - 1.6), 0.03 * np.sin(a - 1.6), 0.0),
            ],
            # A spoke has no thickness: it is seen from both sides.
            "both": True,
        }
        for a in np.arange(3) * 2.0 * np.pi / 3.0
    ]
    return [{**face, "kind": "wheel", "wheel": wheel} for face in _moved(rim + spokes, frame)]


def revolved(profile: list[tuple[float, float]]) -> list[Face]:
    """The surface of a profile (radius, height) that turns about z, seen from the side on the left
    of its direction. One side in seven is darker, so that a spin is seen."""
    a = np.arange(SIDES + 1) * 2.0 * np.pi / SIDES
    faces = []
    for (r, z), (s, w) in zip(profile, profile[1:], strict=False):
        for k in range(SIDES):
            corners = [(r, a[k], z), (r, a[k + 1], z), (s, a[k + 1], w), (s, a[k], w)]
            # A circle of no radius is one corner.
            distinct = [
                c for c, at_axis in zip(corners, (0, r == 0, s == 0, 0), strict=True) if not at_axis
            ]
            points = [(q * np.cos(b), q * np.sin(b), h) for q, b, h in distinct]
            faces.append({"points": points, "kind": "mark" if k == 0 else "face"})
    return faces


def _box(half: np.ndarray) -> list[Face]:
    """A box along the axes with these half-lengths; the face towards +x is marked."""
    faces = []
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        for sign in (1.0, -1.0):
            corners = np.zeros((4, 3))
            corners[:, k] = sign * half[k]
            # Seen from outside they run to the left.
            corners[:, i] = sign * half[i] * np.array([1.0, 1.0, -1.0, -1.0])
            corners[:, j] = half[j] * np.array([-1.0, 1.0, 1.0, -1.0])
            kind = "mark" if k == 0 and sign > 0.0 else "face"
            faces.append({"points": corners.tolist(), "kind": kind})
    return faces


def _moved(faces: list[Face], axes: np.ndarray) -> list[Face]:
    """Faces whose corners are given along the columns of `axes`."""
    # A reflection would turn the faces inside out.
    sign = np.linalg.det(axes)
    turned = axes * np.array([1.0, 1.0, np.sign(sign)])
    return [
        {**f, "points": [(turned @ np.asarray(p)).tolist() for p in f["points"]]} for f in faces
    ]
