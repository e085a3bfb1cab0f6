"""Cells joined one by one, the roomiest first, until two places are connected."""

from __future__ import annotations

from numba import njit

# Cells between two looks at the flag.
_BETWEEN_LOOKS = 65536


@njit(cache=True, nogil=True)
def _root(parent, i):
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True, nogil=True)
def joining_cell(order, n_cols, source, stop, parent):
    """First of ``order`` (K,), flat indices of cells, with which A and B connect by 8 neighbours; -1: none.

    ``source`` (N,) marks cells that belong to A (1) or B (2). ``parent`` (N + 2,) becomes the forest of what
    was joined before that cell, -1 where nothing was; N and N + 1 stand for A and B. Ends with -2 when
    ``stop`` (1,) is set.
    """
    n = source.shape[0]
    n_rows = n // n_cols
    parent[:n] = -1
    parent[n] = n
    parent[n + 1] = n + 1
    for k in range(order.shape[0]):
        if k % _BETWEEN_LOOKS == 0 and stop[0] != 0:
            return -2
        i = order[k]
        row = i // n_cols
        col = i % n_cols
        a = _root(parent, n)
        b = _root(parent, n + 1)
        meets_a = source[i] == 1
        meets_b = source[i] == 2
        for r in range(max(row - 1, 0), min(row + 2, n_rows)):
            for c in range(max(col - 1, 0), min(col + 2, n_cols)):
                j = r * n_cols + c
                if parent[j] >= 0:
                    root = _root(parent, j)
                    meets_a = meets_a or root == a
                    meets_b = meets_b or root == b
        if meets_a and meets_b:
            return i
        top = a if meets_a else b if meets_b else i
        parent[i] = top
        for r in range(max(row - 1, 0), min(row + 2, n_rows)):
            for c in range(max(col - 1, 0), min(col + 2, n_cols)):
                j = r * n_cols + c
                if parent[j] >= 0 and j != i:
                    parent[_root(parent, j)] = top
    return -1


@njit(cache=True, nogil=True)
def sides(parent, out):
    """Which cells connect with A (1) and with B (2) in a forest of ``joining_cell``, into ``out`` (N,)."""
    n = out.shape[0]
    a = _root(parent, n)
    b = _root(parent, n + 1)
    for i in range(n):
        out[i] = 0
        if parent[i] >= 0:
            root = _root(parent, i)
            out[i] = 1 if root == a else 2 if root == b else 0
