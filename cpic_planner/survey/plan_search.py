"""Compiled kernel that searches the plans of a star, the most promising first.

Importing this module loads the compiler: do it inside functions. The kernel takes checked input only.
"""

import heapq

import numpy as np
from numba import njit

from cpic_core import BoolArray, FloatArray, IntArray

_Shown = tuple[IntArray, IntArray, FloatArray, FloatArray]
_Limits = tuple[FloatArray, FloatArray, BoolArray, FloatArray, float]


@njit(cache=True)
def best_plans(
    shown: _Shown, limits: _Limits, known: float, nodes: int, every: bool
) -> tuple[list[IntArray], float, bool]:
    """Return better plans of a star than a known one, what no other passes, and whether the search ended.

    ``shown``: visit ``c`` shows the planets ``planet[start[c]]`` to ``planet[start[c + 1] - 1]`` with these chances;
    ``limits``: what visits pay and take, which of them exclude each other, ratios, and the time. A branch is a set of
    visits that are made, with the first of the others from a place on and any after it; these are in falling order of
    what they add at most. See `cpic_planner.survey.schedule._Star.searched`, whose other arguments these are.
    """
    start, planet, chance, weight = shown
    charge, cost_h, near, ratios, budget_h = limits
    needed, most = ratios.shape[0], ratios.shape[1]
    counts, each = np.empty((needed, weight.size)), np.empty(weight.size)
    made = [np.zeros(0, np.int64)]
    others, gains, nets = [np.arange(charge.size)], [np.zeros(charge.size)], [0.0]
    heap = [(-np.inf, 0, 0, -1)]  # the root, of which no other visit is excluded
    found = [np.zeros(0, np.int64)]
    best, number = known, 0
    for _ in range(nodes + 1):
        if len(heap) == 0 or -heap[0][0] <= best:
            break
        _, _, branch, place = heapq.heappop(heap)
        visits = made[branch]
        if place >= 0:
            visits = np.append(visits, others[branch][place])
        counts[:] = 0.0
        counts[0] = 1.0
        net, room_h = 0.0, budget_h
        for c in visits:
            net -= charge[c]
            room_h -= cost_h[c]
            for j in range(start[c], start[c + 1]):
                p, q = chance[j], planet[j]
                net += weight[q] * counts[needed - 1, q] * p
                for i in range(needed - 1, 0, -1):
                    counts[i, q] += (counts[i - 1, q] - counts[i, q]) * p
                counts[0, q] -= counts[0, q] * p
        if place >= 0 and net > best:
            found.append(visits)
            best = best if every else net
        left = most - visits.size
        if 0 <= place < others[branch].size - 1:
            number += 1
            further = gains[branch][place + 1 : place + left + 2]
            bound = nets[branch] + further[0] + np.maximum(further[1:], 0.0).sum()
            heapq.heappush(heap, (-bound, number, branch, place + 1))
        if left < 1:
            continue
        each[:] = 0.0
        for i in range(needed):
            each += weight * counts[i] * ratios[needed - 1 - i, left - 1] / (needed - i)
        rest = others[branch][place + 1 :]
        own, adds, n = np.empty(rest.size, np.int64), np.empty(rest.size), 0
        for c in rest:
            if cost_h[c] > room_h or (place >= 0 and near[visits[-1], c]):
                continue
            gain = 0.0
            for j in range(start[c], start[c + 1]):
                gain += chance[j] * each[planet[j]]
            gain -= charge[c]
            if every or gain > 0.0:  # the best plan has no visit that takes more than it adds
                own[n], adds[n] = c, gain
                n += 1
        if n == 0:
            continue
        order = np.argsort(-adds[:n], kind="mergesort")
        made.append(visits)
        others.append(own[order])
        gains.append(adds[order])
        nets.append(net)
        number += 1
        bound = net + gains[-1][0] + np.maximum(gains[-1][1:left], 0.0).sum()
        heapq.heappush(heap, (-bound, number, len(made) - 1, 0))
    beyond = -heap[0][0] if len(heap) else best
    return found[1:], max(best, beyond), beyond <= best
