# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Splits the state of one robot into the parts that the page draws (panel.js)."""

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from epson_driver.motion import Array, Trajectory
from epson_driver.motion.interpolation import Interpolation
from epson_driver.pages import packed_arm
from epson_driver.panel.robot_control import RobotControl
from epson_driver.panel.sim_pendant import ONE_CLIENT
from epson_driver.panel.status_lamps import advice, lamps
from epson_driver.panel.window import text_of
from epson_driver.robots import RobotModel
from epson_driver.robots.kinematics import Kinematics, uvw
from epson_driver.tool_motion.tool_pose import pose_of_quaternion

SPAN_S = 20.0  # duration of the curves, s
PERIOD_S = 0.1  # minimum interval between the samples of a curve, s
OVER_S = 0.15
"""Minimum time between two positions from which a velocity is computed, s. Over a shorter time,
the jitter of the time stamps (some milliseconds) would cause spikes."""

GAP_S = 1.0  # maximum time between two positions from which a velocity is computed, s

Row = tuple[float, list[float], list[float] | None, list[float] | None]
"""A sample: time by the panel's clock, s, positions, velocities and tracking errors. Joint values
are in displayed units."""


class History:
    """The samples that the page plots. `per_unit`: displayed units per rad or m, shape (n,)."""

    def __init__(self, per_unit: Array) -> None:
        self._per_unit = per_unit
        self._measured: deque[tuple[float, Array]] = deque()
        self.rows: deque[Row] = deque()

    def add(self, now: float, measured: float, positions: Array, error: Array | None) -> None:
        """Add a sample. `error`: reference minus position, or None without a running goal.

        `now`: the panel's clock, s. `measured`: time of the sample by the driver's clock, s.
        """
        velocities = self._velocities(measured, positions)
        if self.rows and now - self.rows[-1][0] < PERIOD_S:
            return
        self.rows.append(
            (
                round(now, 3),
                self._shown(positions),
                None if velocities is None else self._shown(velocities),
                None if error is None else self._shown(error),
            )
        )
        while now - self.rows[0][0] > SPAN_S:
            self.rows.popleft()

    def _velocities(self, measured: float, positions: Array) -> Array | None:
        samples = self._measured
        if samples and measured <= samples[-1][0]:
            if measured < samples[-1][0]:
                samples.clear()  # the driver's clock was set back
            else:
                samples.pop()
        samples.append((measured, positions))
        while len(samples) > 2 and measured - samples[1][0] >= OVER_S:
            samples.popleft()
        passed = measured - samples[0][0]
        if not 0.0 < passed < GAP_S:
            return None
        return (positions - samples[0][1]) / passed

    def _shown(self, values: Array) -> list[float]:
        result: list[float] = np.round(values * self._per_unit, 4).tolist()
        return result


REFERENCE_LASTS_S = 0.5  # maximum age of the reference while a goal executes, s
SHOWN_UNITS = {'rad': '°', 'm': 'mm'}

SHOWN_EVENTS = 60  # maximum number of log lines in the page
MAX_PLAN_POINTS = 200  # number of points of a drawn tool path
DIGITS = 5  # decimal places of the joints in the 3D view, rad or m
AGES = (('joints', 'joints'), ('status', 'status'), ('driver', 'diagnostics'))
IO_NAMES = {1: 'Inputs', 2: 'Outputs', 3: 'Analog inputs [mV]', 4: 'Analog outputs [mV]'}

OUTPUT, INPUT = 2, 1
ANALOG = (3, 4)
MAX_POINTS = 32  # maximum number of displayed points of each range


class RobotView:
    """The parts of the page for one robot, used in the thread of `Panel.run`."""

    def __init__(
        self, control: RobotControl, trajectories: Mapping[str, Trajectory], label: str
    ) -> None:
        self.control = control
        self.label = label
        self._state = control.robot.state
        self._trajectories = trajectories
        self._model: RobotModel | None = None
        self._model_parts: dict[str, str] = {}
        self._history = History(np.zeros(0))
        self._plan: Trajectory | None = None
        self._plan_part = 'null'
        self._paths = 0
        self._executing = False

    def update(self, now: float) -> None:
        self.control.update()
        state = self._state
        self._update_model()
        age = state.age('reference', now)
        executing = age is not None and age < REFERENCE_LASTS_S
        if self.control.plan is not self._plan:
            self._set_plan(self.control.plan)
        elif executing and not self._executing and not self.control.robot.goals:
            self._set_plan(None)  # the path of another client's goal is unknown
        self._executing = executing
        if self._known and state.fresh('joints', now):
            error = state.tracking_error if executing else None
            self._history.add(now, state.measured, state.positions, error)

    def summary(self, now: float) -> dict[str, Any]:
        result = advice(self._state, now)
        return {
            'name': self.control.robot.name,
            'label': self.label,
            'reason': result.reason,
            'colour': result.colour,
        }

    def parts(self, now: float) -> dict[str, str]:
        state = self._state
        result = advice(state, now)
        return self._model_parts | {
            'plan': self._plan_part,
            'lamps': text_of(lamps(state, now)),
            'advice': text_of(result._asdict()),
            'ages': text_of([[name, _rounded(state.age(key, now))] for name, key in AGES]),
            'log': text_of(
                [[e.time, e.level, e.text] for e in list(state.events)[-SHOWN_EVENTS:]]
            ),
            'io': text_of(self._io()),
            'taught': text_of(self._taught()),
        }

    def controls(self, window: int) -> str:
        holder = self.control.arming.holder
        armed = 'yes' if holder == window else 'no' if holder is None else 'other'
        joints = len(self._state.joint_names)
        return text_of(
            {
                'armed': armed,
                'forbidden': self.control.forbidden() or '',
                'joints': self._state.joint_names,
                'speed': self._state.speed,
                'simulated': self.control.simulated,
                'trajectories': [
                    name
                    for name, item in self._trajectories.items()
                    if joints in (0, len(item.joint_names))
                ],
                'no_plans': self._state.no_plans,
                'no_streams': self._state.no_streams,
                'no_login': ONE_CLIENT if self._state.no_plans else '',
                'axes': [] if self.control.jog_motion is None else self.control.jog_motion.axes,
            }
        )

    def pose(self, now: float) -> dict[str, str]:
        state, model = self._state, self._model
        if model is None or not self._known or self.control.jog_motion is None:
            return {'pose': 'null'}
        place, angles = self.control.jog_motion.kinematics.epson_point(state.positions)
        pose = {
            'fresh': state.fresh('joints', now),
            'joints': np.round(state.positions, DIGITS).tolist(),
            'plan': None,
            'tool': np.round([*(1e3 * place), *np.degrees(angles)], 3).tolist(),
        }
        if self._executing and state.reference is not None:
            pose['plan'] = np.round(state.reference, DIGITS).tolist()
        parts = {'pose': text_of(pose)}
        if self._history.rows:
            parts['row'] = text_of(self._history.rows[-1])
        return parts

    def history(self) -> str:
        return text_of(list(self._history.rows))

    @property
    def _known(self) -> bool:
        model = self._model
        return model is not None and len(self._state.positions) == len(model.joint_names)

    def _update_model(self) -> None:
        model = self.control.model
        if model is self._model:
            return
        self._model = model
        if model is None:
            self._model_parts = {'arm': 'null'}
            return
        self._history = History(model.shown_per_unit)
        limits, per_unit = model.limits, model.shown_per_unit
        self._model_parts = {
            'arm': text_of(
                {
                    'model': model.name,
                    'description': model.description,
                    'units': [SHOWN_UNITS[unit] for unit in limits.units],
                    'per_unit': per_unit.tolist(),
                    'low': (limits.position_min * per_unit).tolist(),
                    'high': (limits.position_max * per_unit).tolist(),
                    'size': float(max(0.5, 0.8 * np.max(model.reach))),
                    'packed': packed_arm(model),
                    'base': model.base.matrix[:3].tolist(),
                }
            )
        }

    def _set_plan(self, plan: Trajectory | None) -> None:
        """Draw the tool path of `plan`. If `plan` is None, draw the reference's path up to now."""
        self._plan = plan
        self._paths += 1
        points: list[list[float]] | None = None
        if plan is not None and len(plan.times) > 1 and self.control.jog_motion is not None:
            points = _tool_path(self.control.jog_motion.kinematics, plan)
        self._plan_part = text_of({'number': self._paths, 'points': points})

    def _taught(self) -> dict[str, list[float]]:
        """Return the driver's points by name, in EPSON's world frame.

        A point is X, Y, Z, mm, and U, V, W, degrees.
        """
        if self.control.jog_motion is None:
            return {}
        arm, result = self.control.jog_motion.kinematics, {}
        for name, values in self._state.taught.items():
            pose = arm.in_base(pose_of_quaternion(name, values))
            place = [*(1e3 * pose[:3, 3]), *np.degrees(uvw(pose[:3, :3]))]
            result[name] = np.round(place, 3).tolist()
        return result

    def _io(self) -> Any:
        state = self._state
        if state.io_reason:
            return state.io_reason
        return [
            {
                'type': item.type,
                'name': IO_NAMES[item.type],
                'start': item.start,
                'values': item.values[:MAX_POINTS],
                'analog': item.type in ANALOG,
            }
            for item in state.io
            if item.type in IO_NAMES and item.values
        ]


def _tool_path(kinematics: Kinematics, plan: Trajectory) -> list[list[float]]:
    times = np.linspace(plan.times[0], plan.times[-1], MAX_PLAN_POINTS)
    dense: Array = Interpolation(plan.times, plan.positions, plan.velocities).at(times)[0]
    return [np.round(kinematics.forward(joints)[:3, 3], 4).tolist() for joints in dense]


def _rounded(age: float | None) -> float | None:
    return None if age is None else round(age, 1)
