"""Stable merge sort for kernels, because numpy's would take longer to compile than all other kernels."""

from __future__ import annotations

from glpath.system.kernels import inner_kernel

#: Length of ranges that are sorted by insertion before they are merged.
_RUN = 16


@inner_kernel
def merge_sort(keys, order, spare, n):  # type: ignore[no-untyped-def]
    """Sort order[:n], indices into `keys`, by their keys; the sort is stable.

    `spare` is working memory of the same length as `order`.
    """
    for begin in range(0, n, _RUN):
        for i in range(begin + 1, min(begin + _RUN, n)):
            item = order[i]
            k = i
            while k > begin and keys[order[k - 1]] > keys[item]:
                order[k] = order[k - 1]
                k -= 1
            order[k] = item
    width = _RUN
    while width < n:
        for begin in range(0, n, 2 * width):
            middle, end = min(begin + width, n), min(begin + 2 * width, n)
            left, right = begin, middle
            for k in range(begin, end):
                if right >= end or (left < middle and keys[order[left]] <= keys[order[right]]):
                    spare[k] = order[left]
                    left += 1
                else:
                    spare[k] = order[right]
                    right += 1
        for k in range(n):
            order[k] = spare[k]
        width *= 2
