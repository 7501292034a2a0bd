# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The view of one robot, as the parts drawn by the page (panel.js)."""

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from epson_driver.motion import Array, Trajectory
from epson_driver.motion.interpolation import Interpolation
from epson_driver.pages import packed_arm
from epson_driver.panel.lamps import advice, lamps
from epson_driver.panel.robot_control import RobotControl
from epson_driver.panel.window import text_of
from epson_driver.robots import RobotModel
from epson_driver.robots.kinematics import Kinematics, uvw
from epson_driver.tool_motion.tool_pose import pose_of_quaternion

SPAN_S = 20.0
PERIOD_S = 0.1

OVER_S = 0.15
"""Minimum interval of a velocity's position difference, s. Time stamps jitter by milliseconds, so
closer samples would give spikes."""

GAP_S = 1.0
"""Maximum interval of a velocity's position difference, s."""

Row = tuple[float, list[float], list[float] | None, list[float] | None]
"""Time by the panel's clock, s, then positions, velocities and errors in shown units."""


class History:
    """Samples of n joints over the last SPAN_S. `per_unit`: shown units per rad or m."""

    def __init__(self, per_unit: Array) -> None:
        self._per_unit = per_unit
        self._measured: deque[tuple[float, Array]] = deque()
        self.rows: deque[Row] = deque()

    def add(self, now: float, measured: float, positions: Array, error: Array | None) -> None:
        """Add a sample, with the tracking error (plan minus position) if a plan is running.

        now: the panel's clock, s. measured: the sample's time by the driver's clock, s.
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
                samples.clear()  # another clock
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


REFERENCE_LASTS_S = 0.5
"""Time after the last ~/controller_state (20 Hz) for which a trajectory counts as executing, s."""

SHOWN_UNITS = {'rad': '°', 'm': 'mm'}

SHOWN_EVENTS = 60

MAX_PLAN_POINTS = 200

DIGITS = 5
"""Decimal places of joints in rad or m, in the 3D view."""

AGES = (('joints', 'joints'), ('status', 'status'), ('driver', 'diagnostics'))
"""Values with a shown age: the name in the page and in the state."""

IO_NAMES = {
    1: 'Inputs',
    2: 'Outputs',
    3: 'Analog inputs [mV]',
    4: 'Analog outputs [mV]',
}
"""Names of the types of epson_msgs/IoPoint."""

OUTPUT, INPUT = 2, 1
ANALOG = (3, 4)
MAX_POINTS = 32
"""Maximum number of points shown of each type."""


class RobotView:
    """The parts of a robot's page, created in the panel's own thread.

    `label`: the robot's name in the page.
    """

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
        self._ways = 0
        self._executing = False

    def look(self, now: float) -> None:
        """Update from the driver's state and extend the curves."""
        self.control.look()
        state = self._state
        self._take_over_model()
        age = state.age('reference', now)
        executing = age is not None and age < REFERENCE_LASTS_S
        if self.control.plan is not self._plan:
            self._new_way(self.control.plan)
        elif executing and not self._executing and not self.control.robot.goals:
            self._new_way(None)  # another client's goal: its path is unknown
        self._executing = executing
        if self._known and state.fresh('joints', now):
            error = state.tracking_error if executing else None
            self._history.add(now, state.measured, state.positions, error)

    def summary(self, now: float) -> dict[str, Any]:
        """Return the robot's entry in every window's list: its name, and why it cannot move."""
        result = advice(self._state, now)
        return {
            'name': self.control.robot.name,
            'label': self.label,
            'reason': result.reason,
            'colour': result.colour,
        }

    def parts(self, now: float) -> dict[str, str]:
        """Return the rarely changing parts, as texts, by name."""
        state = self._state
        result = advice(state, now)
        return self._model_parts | {
            'plan': self._plan_part,
            'lamps': text_of(lamps(state, now)),
            'advice': text_of(result._asdict()),
            'ages': text_of([[name, _rounded(state.age(key, now))] for name, key in AGES]),
            'log': text_of([[e.at, e.level, e.text] for e in list(state.events)[-SHOWN_EVENTS:]]),
            'io': text_of(self._io()),
            'taught': text_of(self._taught()),
        }

    def controls(self, window: int) -> str:
        """Return the controls available to a window now."""
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
                'axes': [] if self.control.hand is None else self.control.hand.axes,
            }
        )

    def pose(self, now: float) -> dict[str, str]:
        """Return the pose of the arm and of the plan, and the newest row of the curves."""
        state, model = self._state, self._model
        if model is None or not self._known or self.control.hand is None:
            return {'pose': 'null'}
        place, angles = self.control.hand.kinematics.epson_point(state.positions)
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
        """Return all rows of the curves."""
        return text_of(list(self._history.rows))

    @property
    def _known(self) -> bool:
        """Whether the reported joints match the model."""
        model = self._model
        return model is not None and len(self._state.positions) == len(model.joint_names)

    def _take_over_model(self) -> None:
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

    def _new_way(self, plan: Trajectory | None) -> None:
        """Draw the tool path of a plan. None: draw the reference as it arrives."""
        self._plan = plan
        self._ways += 1
        points: list[list[float]] | None = None
        if plan is not None and len(plan.times) > 1 and self.control.hand is not None:
            points = _tool_path(self.control.hand.kinematics, plan)
        self._plan_part = text_of({'way': self._ways, 'points': points})

    def _taught(self) -> dict[str, list[float]]:
        """Return the driver's points as X, Y, Z, mm, and U, V, W, degrees, in EPSON's world."""
        if self.control.hand is None:
            return {}
        arm, result = self.control.hand.kinematics, {}
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
