"""Decimation of signals for display that keeps the extremes of every pixel column."""

from __future__ import annotations

import math

import numpy as np

from piezo_hysteresis.arrays import FloatArray, IntArray


def columns(first: int, values: FloatArray, pixels: int) -> tuple[IntArray, FloatArray]:
    """Return the smallest and the largest value of every pixel column with their positions.

    Columns hold equal numbers of samples and begin at multiples of that number, for any part of
    the signal: a peak keeps its height while it moves across the screen.
    """
    # values (n,)
    if pixels < 1:
        raise ValueError(f'{pixels} pixel columns: give at least 1')
    samples = np.arange(first, first + values.size)
    width = math.ceil(values.size / pixels)
    if width <= 2:
        return samples, values
    before = first % width
    after = -(before + values.size) % width
    blocks = np.pad(values, (before, after), constant_values=np.nan).reshape(-1, width)
    empty = np.isnan(blocks)
    low = np.where(empty, np.inf, blocks).argmin(axis=1)
    high = np.where(empty, -np.inf, blocks).argmax(axis=1)
    within = np.sort(np.stack([low, high], axis=1), axis=1)
    rows = np.arange(len(blocks))[:, None]
    drawn = blocks[rows, within]
    places = first - before + rows * width + within
    # a column without values may begin before the signal or end behind it
    inside = np.clip(places, first, first + values.size - 1)
    return inside.ravel(), drawn.ravel()


def path(x: FloatArray, y: FloatArray, points: int) -> tuple[FloatArray, FloatArray]:  # x, y (n,)
    """Return at most `points` points of a curve in the plane, with the extremes of both axes."""
    if x.size <= points:
        return x, y
    width = math.ceil(x.size / (points // 4))
    missing = -x.size % width
    keep = []
    for values in (x, y):
        blocks = np.pad(values, (0, missing), constant_values=np.nan).reshape(-1, width)
        empty = np.isnan(blocks)
        keep.append(np.where(empty, np.inf, blocks).argmin(axis=1))
        keep.append(np.where(empty, -np.inf, blocks).argmax(axis=1))
    places = np.sort(np.stack(keep, axis=1), axis=1) + width * np.arange(len(keep[0]))[:, None]
    order = np.unique(np.minimum(places.ravel(), x.size - 1))
    return x[order], y[order]
