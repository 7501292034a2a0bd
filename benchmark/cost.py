# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a step of the smoother costs, whether few or many points have gone by.

`make bench`: a stream of points 4 ms apart, one second of them known ahead, planned outside of the
steps as the simulated controller does it.
"""

import gc
import pickle
import time
import tracemalloc

import numpy as np

from epson_driver.motion.smoother import Mode, Smoother, plan
from epson_driver.robots import load_robot_model

CYCLE_S = 0.004
LENGTHS = (10, 100, 1_000, 10_000, 50_000)
MEASURED_STEPS = 2_000
"""How many of the last steps are measured."""

HOME = np.array([0.0, -0.5, 1.0, 0.0, -1.0, 0.0])
POINT_PERIOD_S = 0.004


def measure(length: int) -> tuple[float, float, float, int]:
    """Return the median and the 99th percentile of a step, s, memory, kB, and points ahead."""
    limits = load_robot_model('c3_a601s').limits
    smoother = Smoother(limits, HOME, Mode.TIME_PRESERVING, latency=CYCLE_S, planner=None)
    sent, costs = 0, []
    first_measured = max(length * POINT_PERIOD_S - MEASURED_STEPS * CYCLE_S, 0.0)
    now = 0.0
    tracemalloc.start()
    while sent < length or smoother.moving:
        while sent < length and smoother.look_ahead < 1.0:
            sent += 1
            angle = POINT_PERIOD_S * sent * np.arange(1, 7) / 3.0
            smoother.append(HOME + 0.2 * np.sin(angle), POINT_PERIOD_S)
        measured = now >= first_measured
        if measured and tracemalloc.is_tracing():
            gc.collect()
            memory = tracemalloc.get_traced_memory()[0] / 1e3
            ahead = smoother.points_ahead
            tracemalloc.stop()
        begin = time.perf_counter()
        request = smoother.request()
        asked = time.perf_counter() - begin
        if request is not None:
            answer = pickle.loads(pickle.dumps(plan(request, limits)))
            begin = time.perf_counter()
            smoother.take(answer)
            asked += time.perf_counter() - begin
        begin = time.perf_counter()
        smoother.step(CYCLE_S)
        if measured:
            costs.append(asked + time.perf_counter() - begin)
        now += CYCLE_S
    return float(np.median(costs)), float(np.percentile(costs, 99)), memory, ahead


def main() -> None:
    """Print a row for each length."""
    print('points   median / cycle   p99 / cycle   p99 / p99 of the first   memory   points ahead')
    first = 0.0
    for length in LENGTHS:
        median, p99, memory, ahead = measure(length)
        first = first or p99
        print(
            f'{length:6}   {median / CYCLE_S:14.4f}   {p99 / CYCLE_S:11.4f}   {p99 / first:22.2f}'
            f'   {memory:3.0f} kB   {ahead:12}',
            flush=True,
        )


if __name__ == '__main__':
    main()
