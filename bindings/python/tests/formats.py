"""Frames as the sensors of cameras send them, made of RGB by the definition of BT.601."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]


def planes(rgb: Bytes) -> tuple[Bytes, Bytes, Bytes]:
    """Y of full size, U and V of half width and height."""
    r, g, b = (rgb[..., i].astype(np.float64) for i in range(3))
    y = 16 + 0.257 * r + 0.504 * g + 0.098 * b
    u = 128 - 0.148 * r - 0.291 * g + 0.439 * b
    v = 128 + 0.439 * r - 0.368 * g - 0.071 * b
    height, width = y.shape

    def halved(plane: NDArray[np.float64]) -> Bytes:
        means: Bytes = np.rint(plane.reshape(height // 2, 2, width // 2, 2).mean((1, 3))).astype(np.uint8)
        return means

    return np.rint(y).astype(np.uint8), halved(u), halved(v)


def raw(rgb: Bytes, form: str) -> Bytes:
    """The bytes of a frame in a format, one after the other."""
    if form == "rgb":
        return rgb.reshape(-1)
    if form in ("rgb565", "rgb565be"):
        r, g, b = (rgb[..., i].astype(np.uint16) for i in range(3))
        words = (r >> 3) << 11 | (g >> 2) << 5 | b >> 3
        data = words.astype("<u2" if form == "rgb565" else ">u2").tobytes()
        return np.frombuffer(data, np.uint8)
    y, u, v = planes(rgb)
    if form == "gray":
        return y.ravel()
    if form == "nv12":
        return np.concatenate([y.ravel(), np.stack([u, v], -1).ravel()])
    if form == "i420":
        return np.concatenate([y.ravel(), u.ravel(), v.ravel()])
    wide = [np.repeat(plane, 2, 0) for plane in (u, v)]
    pairs = [y[:, ::2], wide[0], y[:, 1::2], wide[1]]
    order = pairs if form == "yuyv" else [pairs[1], pairs[0], pairs[3], pairs[2]]
    return np.stack(order, -1).ravel()
