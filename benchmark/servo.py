# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How far the arm is behind a stream of setpoints: through ROS, the driver and a controller.

`python -m benchmark.servo` runs each kind of stream on each kind of controller, a process each, in
eleven minutes, and writes results/servo.json, results/servo.md and the picture of docs/servo.md.
`--quick` runs a part in a minute and writes to build/bench-servo. Streams have 4 ms of jitter, and
2 % of the messages are lost. The machine should have nothing else to do.
"""

import argparse
import os
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmark import servo_results
from benchmark.servo_results import Dropout, Lag, Results, Trace
from benchmark.servo_streams import WAVES, Wave
from benchmark.servo_user import User
from epson_driver.cli import processes
from epson_driver.motion import Array
from epson_driver.robots import load_robot_model

ROOT = Path(__file__).parents[1]
MODEL = load_robot_model('c3_a601s')
START = (0.0, 0.1, 0.2, 0.0, -0.5, 0.0)

DURATION_S = 6.0
"""All waves are back where they began then: otherwise the arm drifts to the end of its range."""

SETTLED_S = 1.2
"""What is measured begins so long after the stream, s."""

MAX_LAG_S = 1.5
FOLLOWED_RAD = 0.01
"""An arm that moved less did not follow at all."""

DROPOUTS_S = (1.05, 1.3, 1.55)
"""When a stream falls silent for good: on the way there, at the turn, on the way back."""

TRACED = ('sine', 'positions', 50.0)
"""The run whose trace is drawn."""


@dataclass(frozen=True)
class Kind:
    """A kind of controller: the driver's profile, and arguments of the simulated controller."""

    profile: str
    arguments: tuple[str, ...] = ()
    thorough: bool = False


KINDS = {
    'setpoints': Kind('setpoints', thorough=True),
    'rc620, smooth': Kind('rc620', ('--motion=smooth',), thorough=True),
    'rc620, point to point': Kind('rc620', ('--motion=ptp',)),
    'generic': Kind('generic', ('--motion=ptp',)),
    'fanuc': Kind('fanuc', ('--motion=ptp',)),
    'spel': Kind('spel'),
    'thesis': Kind('thesis', ('--motion=ptp',)),
}

Run = tuple[str, str, float]
"""Wave, stream, and rate in Hz."""

SHORT: tuple[Run, ...] = (
    ('sine', 'positions', 30.0),
    TRACED,
    ('sine', 'positions', 100.0),
    ('sine', 'with velocities', 50.0),
    ('sine', 'windows', 30.0),
    ('sine', 'windows', 100.0),
    ('ramp', 'positions', 50.0),
    ('steps', 'positions', 50.0),
    ('jog', 'velocities', 50.0),
)
THOROUGH: tuple[Run, ...] = (
    *SHORT,
    ('sine', 'with velocities', 30.0),
    ('sine', 'with velocities', 100.0),
    ('sine', 'windows', 50.0),
    ('ramp', 'with velocities', 50.0),
    ('ramp', 'windows', 50.0),
)
QUICK: tuple[Run, ...] = (TRACED, ('sine', 'windows', 100.0), ('jog', 'velocities', 50.0))


def best_lag(times: Array, ways: Array, wave: Wave, duration: float) -> tuple[float, float]:
    """Return the delay with which a wave is nearest to what was measured, s, and how near, rms.

    times, ways: shape (k,). Raises ValueError if nothing was measured in time.
    """
    chosen = (times > SETTLED_S) & (times < duration)
    if not chosen.any():
        raise ValueError('no joint states while the stream ran')
    grid = np.arange(-MAX_LAG_S, duration, 0.002)
    known = np.array([wave(max(t, 0.0))[0] for t in grid])
    found = (np.inf, 0.0)
    for lag in np.arange(-0.1, MAX_LAG_S, 0.002):
        wanted = np.interp(times[chosen] - lag, grid, known)
        rms = float(np.sqrt(np.mean((ways[chosen] - wanted) ** 2)))
        found = min(found, (rms, float(lag)))
    return found[1], found[0]


def measured(user: User, kind: str, run: Run) -> tuple[Lag, Trace | None]:
    """Run a stream, and return how the arm followed."""
    name, stream, rate = run
    wave = WAVES[name]
    taken = user.stream(stream, wave, DURATION_S, rate).taken()
    times, ways = taken.times, taken.ways
    if not len(ways) or float(np.abs(ways).max()) < FOLLOWED_RAD:
        raise TimeoutError(f'the arm did not follow {name}, {stream}, {rate:g} Hz')
    lag, rms = best_lag(times, ways, wave, DURATION_S)
    fastest = float(np.max(taken.fastest / MODEL.limits.velocity))
    trace = None
    if run == TRACED:
        grid = np.linspace(0.0, DURATION_S, 251)
        followed = np.interp(grid, times, ways)
        trace = Trace(kind, grid.tolist(), [wave(t)[0] for t in grid], followed.tolist())
    return Lag(kind, name, stream, rate, lag, rms, fastest), trace


def dropped(user: User, kind: str, at: float) -> Dropout:
    """Let a stream fall silent at a time, and return how the arm came to rest."""
    wave = WAVES['sine']
    recording = user.stream('positions', wave, at, 50.0)
    rested = user.rest()
    taken = recording.taken()
    limits = MODEL.limits
    inside = bool(
        np.all((taken.positions >= limits.position_min) & (taken.positions <= limits.position_max))
    )
    past, beyond = where_it_rests(taken.ways, wave, at)
    return Dropout(
        kind,
        at,
        max(rested - recording.begin - at, 0.0),
        past,
        beyond,
        float(np.max(taken.fastest / limits.velocity)),
        inside,
    )


def where_it_rests(ways: Array, wave: Wave, at: float) -> tuple[float, float]:
    """Return how far past the last setpoint an arm rests, and how far beyond all that was sent.

    ways: of the arm from the stream's begin until it rested, rad, shape (k,). Past is in the
    direction in which the setpoints went, rad; negative: before the last one.
    """
    sent = np.array([wave(t)[0] for t in np.linspace(0.0, at, 1001)])
    last, velocity = wave(at)
    past = float((ways[-1] - last) * (np.sign(velocity) or 1.0))
    return past, float(max(ways.max() - sent.max(), sent.min() - ways.min(), 0.0))


def run_kind(name: str, runs: Iterable[Run], dropouts: Iterable[float], results: Results) -> None:
    """Run streams on one kind of controller, and add the figures. Raises RunError."""
    kind = KINDS[name]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        arguments = (f'--controller={kind.profile}', *kind.arguments)
        simulated = processes.sim_controller(folder / 'controller.log', *arguments, start=START)
        with processes.ended_at_exit(simulated):
            domain = processes.free_ros_domain()
            client = processes.client(
                folder / 'client.log', simulated.ports(), domain, controller=kind.profile
            )
            with processes.ended_at_exit(client):
                os.environ.update(processes.ros_environment(domain))
                user = User()
                try:
                    user.enable()
                    for run in runs:
                        lag, trace = measured(user, name, run)
                        results.lags.append(lag)
                        if trace is not None:
                            results.traces.append(trace)
                        print(servo_results.line(lag), flush=True)
                    for at in dropouts:
                        results.dropouts.append(dropped(user, name, at))
                        print(servo_results.dropout_line(results.dropouts[-1]), flush=True)
                    client.check_alive()
                except TimeoutError as error:
                    raise processes.RunError(
                        f'{name}: {error}\n{client.log_text()}\n{simulated.log_text()}'
                    ) from error
                finally:
                    user.close()


def main() -> None:
    """Run what was chosen, and write the figures."""
    parser = argparse.ArgumentParser(description='Lag of the arm behind streams of setpoints.')
    parser.add_argument('--quick', action='store_true', help='a part, in a minute')
    parser.add_argument('--only', nargs='+', choices=list(KINDS), help='kinds of controllers')
    parser.add_argument('--render', action='store_true', help='report and picture once more')
    args = parser.parse_args()
    whole = not (args.quick or args.only)
    folder = ROOT / 'benchmark' / 'results' if whole else ROOT / 'build' / 'bench-servo'
    picture = ROOT / 'docs' / 'images' / 'servo.png' if whole else folder / 'servo.png'
    if args.render:
        servo_results.render(servo_results.read(folder), folder, picture)
        return
    results = Results([], [], [])
    for name in args.only or (next(iter(KINDS)),) if args.quick else args.only or KINDS:
        runs = QUICK if args.quick else THOROUGH if KINDS[name].thorough else SHORT
        run_kind(name, runs, DROPOUTS_S[: 1 if args.quick else None], results)
    servo_results.write(results, folder, picture)


if __name__ == '__main__':
    main()
