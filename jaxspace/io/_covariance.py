"""Covariances of states in the axes that messages of CCSDS give them in.

    RTN (RSW)   R along the position, N along the angular momentum, T = N x R
    TNW         T along the velocity, W along the angular momentum, N = W x T

Source: CCSDS 502.0-B-3, Orbit Data Messages, 3.2.4.11; SANA registry of orbit-relative frames.
"""

import numpy as np

from ..core import InputError
from ..sampling import MultivariateNormal


def distribution_of(
    position: np.ndarray, velocity: np.ndarray, covariance: np.ndarray, axes: str, frame: str
) -> MultivariateNormal:
    """The distribution of position and velocity in the `frame` of the state from a covariance in
    some `axes`. Raises `InputError` for axes that do not follow from the state."""
    turn = np.kron(np.eye(2), _directions(position, velocity, axes, frame))
    mean = np.concatenate([position, velocity])
    return MultivariateNormal(mean, turn @ covariance @ turn.T)


def _directions(position: np.ndarray, velocity: np.ndarray, axes: str, frame: str) -> np.ndarray:
    """The directions of the axes in the frame of the state, a column each."""
    if axes == frame:
        return np.eye(3)
    normal = np.cross(position, velocity)
    if axes in ("RTN", "RSW", "TNW") and not np.any(normal):
        raise InputError(f"The covariance is in {axes}, and the state has no orbital plane.")
    if axes in ("RTN", "RSW"):
        normal = normal / np.linalg.norm(normal)
        radial = position / np.linalg.norm(position)
        return np.column_stack([radial, np.cross(normal, radial), normal])
    if axes == "TNW":
        normal = normal / np.linalg.norm(normal)
        ahead = velocity / np.linalg.norm(velocity)
        return np.column_stack([ahead, np.cross(normal, ahead), normal])
    raise InputError(
        f"The covariance is in {axes}, and the state in {frame}: both must have the same axes, or "
        "the covariance those of RTN, RSW or TNW."
    )
