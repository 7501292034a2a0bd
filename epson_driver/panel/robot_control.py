# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel's actions on one robot, and the conditions for each action.

`stop` and `disable` are always available. An action that moves the arm, permits motion or switches
an output requires an armed browser. Arming requires recent data, and either a simulated controller
or a panel that was started with `--allow-motion`.
"""

import contextlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from epson_driver.motion import Array, Trajectory
from epson_driver.panel.arming import Arming
from epson_driver.panel.jog import Jog
from epson_driver.panel.robot_state import (
    ERROR,
    INFO,
    MAX_AGES_S,
    WARN,
    RequestError,
    Robot,
    Simulation,
)
from epson_driver.panel.sim_pendant import NotSimulatedError, SimPendant
from epson_driver.remote_ethernet.hand import ACTIONS, Action, UsageError, action
from epson_driver.robots import RobotModel, load_robot_model
from epson_driver.setup.table import ROWS

START_TOLERANCE: float = ROWS['start_tolerance'].default  # rad or m
MIN_SPEED = 0.01  # minimum speed as a fraction of the velocity limits, as in SPEL+
STOP_ANSWER_S = 0.5  # time without an answer to STOP after which the panel raises an alarm, s

PENDANT: dict[str, dict[str, Action]] = {
    label: {way: ACTIONS[f'{first} {way}'.strip()] for way in ways}
    for label, first, ways in (
        ('E-stop', 'estop', ('press', 'release')),
        ('Door', 'door', ('open', 'close')),
        ('Tasks', '', ('pause', 'continue', 'stop', 'start')),
        ('Motors', 'motors', ('on', 'off')),
        ('Key', 'mode', ('auto', 'manual')),
        ('Error', '', ('reset',)),
    )
}
"""Actions of the simulated pendant: label of the item → label of the button → action."""


class RobotControl:
    """The actions on one robot, for all browsers. Methods are thread-safe and do not block.

    The methods raise RequestError if an action is not possible now. `browser` is the number of the
    window that requests it. `pendant` returns the simulated pendant at a host and a port, or None
    if the controller there must not be queried.
    """

    def __init__(
        self,
        robot: Robot,
        pendant: Callable[[str, int], SimPendant | None],
        clock: Callable[[], float],
        *,
        allow_motion: bool,
    ) -> None:
        self.robot = robot
        self.model: RobotModel | None = None
        self.jog_motion: Jog | None = None  # None while the model is unknown
        self.plan: Trajectory | None = None  # the last trajectory sent by the panel
        self.arming = Arming(self.forbidden, self._on_disarmed, clock)
        self._model_name = ''  # the driver's parameter `robot_model` that `model` belongs to
        self._pendant_of = pendant
        self._pendant: SimPendant | None = None
        self._pendant_at: tuple[str, int] | None = None
        self._clock = clock
        self._allow_motion = allow_motion
        self._jogging = False
        self._speed_wanted: float | None = None
        self._speed_requested = False
        self.stop_alarm = ''  # why a STOP was not carried out, with the remedy, or ''
        self._stops = 0
        self._stop_requested_at: float | None = None

    # --- identity ---------------------------------------------------------------------------

    @property
    def simulated(self) -> bool:
        """Whether the controller has recently reported to be a simulated one."""
        state = self.robot.state
        known = self._pendant_at == self._address and state.simulation is not None
        return known and state.fresh('simulation', self._clock())

    @property
    def _address(self) -> tuple[str, int] | None:
        parameters = self.robot.parameters
        if not parameters:
            return None
        return str(parameters['robot_ip']), int(parameters['remote_port'])

    def update(self) -> None:
        """Update model, pendant, arming and STOP alarm.

        It is called in the thread of `Panel.run`.
        """
        parameters = self.robot.parameters
        address = self._address
        if parameters and parameters['robot_model'] != self._model_name:
            self._load(str(parameters['robot_model']))
        if address != self._pendant_at:
            if self._pendant is not None:
                self._pendant.end()
            self._pendant_at = address
            self._pendant = None if address is None else self._pendant_of(*address)
        state, latest = self.robot.state, None if self._pendant is None else self._pendant.latest
        if latest is None:
            state.simulation = None
            state.times.pop('simulation', None)
        else:
            state.simulation, state.times['simulation'] = latest
            self._take_simulated_joints(*latest)
        self.arming.watch()
        requested_at = self._stop_requested_at
        if requested_at is not None and self._clock() - requested_at > STOP_ANSWER_S:
            self._stop_requested_at = None
            self._raise_alarm(f'no reply from the driver within {STOP_ANSWER_S:g} s')

    def _take_simulated_joints(self, simulation: Simulation, arrival: float) -> None:
        """Take the joints of a program that runs, which a controller withholds from the driver."""
        state, model = self.robot.state, self.model
        withheld = state.age('joints withheld', self._clock())
        wanted = withheld is not None and withheld < MAX_AGES_S['joints']
        if self._pendant is not None:
            self._pendant.joints_wanted = wanted
        if wanted and model is not None and len(simulation.joints) == len(model.joint_names):
            state.joint_names = model.joint_names
            state.positions = np.array(simulation.joints) / model.shown_per_unit
            state.measured = state.times['joints'] = arrival

    def end(self) -> None:
        self.arming.disarm('the robot has disappeared')
        if self._pendant is not None:
            self._pendant.end()

    def _load(self, name: str) -> None:
        self._model_name = name
        try:
            self.model = load_robot_model(name)
            self.jog_motion = Jog(self.model)
            self.robot.state.fastest = self.model.limits.velocity.tolist()
        except (OSError, ValueError) as error:
            self.model = self.jog_motion = None
            self.robot.state.fastest = ()
            self.robot.log(f'no 3D view of the arm: {error}', WARN)
            return
        for sentence in self.model.cautions:
            self.robot.log(sentence, WARN)

    def forbidden(self) -> str | None:
        """Return why arming is not allowed now, or None."""
        now, state = self._clock(), self.robot.state
        sources = (('diagnostics', 'the driver does not report'), ('status', 'no robot_status'))
        missing = next((text for name, text in sources if not state.fresh(name, now)), '')
        if not missing and state.joints_missing(now):
            missing = state.no_joints or 'no joint states'
        if missing:
            return f'{missing}: motion needs a visible robot'
        if state.link != 'connected':
            return 'no link to the controller'
        first = state.times.get('first joints')
        if first is None or state.times.get('parameters', 0.0) < first:
            return 'the robot of the driver is still unknown'
        if not self._allow_motion and not self.simulated:
            return (
                'this robot is real, or not known to be simulated: only a panel started with '
                '--allow-motion may move it'
            )
        return None

    def _on_disarmed(self, why: str) -> None:
        self.jog_end()
        self.robot.log(f'panel disarmed: {why}', INFO)
        if self.robot.cancel_goals():
            self.robot.log('canceling the goals of the panel', WARN)

    # --- always -----------------------------------------------------------------------------

    def stop(self) -> None:
        """Stop the arm. Set `stop_alarm` if the driver is silent or does not answer in time."""
        self._stops += 1
        now, number = self._clock(), self._stops
        self._stop_requested_at = now

        def answered(text: str, level: int) -> None:
            self.robot.log(text, level)
            if number != self._stops:
                return
            self._stop_requested_at = None
            if level < ERROR:
                self.stop_alarm = ''
            else:
                self._raise_alarm(text, 'STOP failed')

        why = '' if self.robot.state.fresh('diagnostics', now) else 'the driver is silent'
        try:
            self.robot.trigger('stop', answered)
        except RequestError as error:
            why = str(error)
            raise
        finally:
            if why:
                self._stop_requested_at = None
                self._raise_alarm(why)

    def _raise_alarm(self, why: str, what: str = 'STOP was not delivered') -> None:
        self.stop_alarm = f'{what}: {why}. Press the E-stop.'
        self.robot.log(self.stop_alarm, ERROR)

    def disable(self) -> None:
        self.robot.trigger('disable', self.robot.log)

    # --- for the armed browser --------------------------------------------------------------

    def enable(self, browser: int) -> None:
        with self.arming.held(browser):
            self.robot.trigger('enable', self.robot.log)

    def reset_error(self, browser: int) -> None:
        with self.arming.held(browser):
            self.robot.trigger('reset_error', self.robot.log)

    def set_speed(self, browser: int, factor: float) -> None:
        """Set the speed scaling, 0 … 1.

        While another request is pending, the latest value is queued.
        """
        with self.arming.held(browser):
            self._speed_wanted = factor
            if not self._speed_requested:
                self._ask_speed()

    def _ask_speed(self) -> None:
        factor, self._speed_wanted = self._speed_wanted, None
        if factor is None:
            return
        self._speed_requested = True

        def answered(text: str, level: int) -> None:
            if level >= WARN:
                self.robot.log(text, level)
            self._speed_requested = False
            try:
                self._ask_speed()
            except RequestError as error:
                self.robot.log(str(error), ERROR)

        try:
            self.robot.set_speed(factor, answered)
        except RequestError:
            self._speed_requested = False
            raise

    def write_output(self, browser: int, index: int, value: int) -> None:
        with self.arming.held(browser):
            self.robot.write_output(index, value, self.robot.log)

    def execute(self, browser: int, name: str, trajectory: Trajectory) -> None:
        """Execute a trajectory.

        The trajectory has the joint names of the driver or of the robot model.
        """
        with self.arming.held(browser):
            if self.robot.state.no_plans:
                raise RequestError(self.robot.state.no_plans)
            self._send(name, self._renamed(trajectory))

    def go_to_start(self, browser: int, name: str, trajectory: Trajectory) -> None:
        """Move slowly to the start of a trajectory, on a straight line in joint space."""
        with self.arming.held(browser):
            here, start = self._here(), self._renamed(trajectory).positions[0]
            self._send(f'to the start of {name}', self._jog_motion().straight(here, start))

    def go_to(self, browser: int, name: str, point: Array) -> None:
        """Move slowly to a point, on a straight line in joint space.

        `point`: X, Y, Z, mm, and U, V, W, degrees, shape (6,).
        """
        with self.arming.held(browser):
            here, motion = self._here(), self._jog_motion()
            self._send(f'to {name}', motion.straight(here, motion.joints_at(point, here)))

    def jog(self, browser: int, axis: str, frame: str, fraction: float) -> None:
        """Move for the time of the driver's parameter `servo.timeout` (0.1 s).

        The arguments are those of `Jog.velocities`. If `fraction` is 0, the arm brakes.
        """
        with self.arming.held(browser):
            if self.robot.state.no_streams:
                raise RequestError(self.robot.state.no_streams)
            velocities = self._jog_motion().velocities(self._here(), axis, frame, fraction)
            self.robot.jog(self.robot.state.joint_names, velocities)
            self._jogging = bool(np.any(velocities))

    def jog_end(self) -> None:
        if self._jogging:
            self._jogging = False
            names = self.robot.state.joint_names
            self.robot.jog(names, np.zeros(len(names)))

    def step(self, browser: int, axis: str, frame: str, size: float, fraction: float) -> None:
        with self.arming.held(browser):
            if self.robot.goals:
                raise RequestError(
                    'the previous motion that the panel requested has not ended yet'
                )
            motion = self._jog_motion()
            trajectory = motion.step(self._here(), axis, frame, size, fraction)
            self._send(f'step of {axis}', trajectory, straight=axis in motion.axes)

    def _jog_motion(self) -> Jog:
        if self.jog_motion is None:
            raise RequestError('the robot model is unknown')
        return self.jog_motion

    def _here(self) -> Array:
        here = self.robot.state.positions
        if self.model is None or len(here) != len(self.model.joint_names):
            raise RequestError('the robot model is unknown, or has other joints')
        if not self.robot.state.fresh('joints', self._clock()):
            raise RequestError('the controller does not report its joints now')
        return here

    def away_from_start(self, trajectory: Trajectory) -> str:
        """Return the largest distance of a joint from the start of a trajectory, as a clause.

        '' if all joints are within START_TOLERANCE of the start, or if the numbers of joints
        differ.
        """
        here = self.robot.state.positions
        if len(here) != trajectory.positions.shape[1]:
            return ''
        away = np.abs(self._renamed(trajectory).positions[0] - here)
        worst = int(np.argmax(away))
        if away[worst] <= START_TOLERANCE:
            return ''
        name, unit = f'joint {worst + 1}', 'rad'
        if self.model is not None:
            name, unit = self.model.joint_names[worst], self.model.limits.units[worst]
        shown = f'{1e3 * away[worst]:.1f} mm' if unit == 'm' else f'{np.degrees(away[worst]):.1f}°'
        return f'{name} is {shown} away'

    def _renamed(self, trajectory: Trajectory) -> Trajectory:
        names = self.robot.state.joint_names
        count = trajectory.positions.shape[1]
        if count != len(names):
            raise RequestError(f'the trajectory has {count} joints, but the robot {len(names)}')
        for known in (names, () if self.model is None else self.model.joint_names):
            if {*known} == {*trajectory.joint_names}:
                trajectory = trajectory.in_order(known)
                break
        return replace(trajectory, joint_names=names)

    def _send(self, name: str, trajectory: Trajectory, *, straight: bool = False) -> None:
        """Send a trajectory.

        If the controller accepts no trajectories, only the last point is sent. `straight`: the
        tool moves on a straight line. All points are then sent, because every controller accepts
        straight lines.
        """
        trajectory = replace(trajectory, joint_names=self.robot.state.joint_names)
        goal = trajectory
        if self.robot.state.no_plans and self.model is not None:
            away = np.abs(goal.positions[-1] - self._here()) / self.model.limits.velocity
            longest = max(float(np.max(away)) / MIN_SPEED, 1e-3)
            times = goal.times * min(1.0, longest / goal.duration)
            sent = slice(0 if straight else -1, None)
            goal = Trajectory(goal.joint_names, times[sent], goal.positions[sent])
        self.robot.execute(goal, name, self.robot.log)
        self.plan = trajectory
        self.robot.log(f'goal sent: {name}', INFO)

    # --- at the simulated pendant -----------------------------------------------------------

    def press(self, browser: int, what: str, how: str) -> None:
        """Press the button `how` of the item `what` in PENDANT.

        Buttons that permit motion require an armed browser.
        """
        press = PENDANT[what][how]
        with self.arming.held(browser) if press.moves else contextlib.nullcontext():
            self._press(press, f'pendant: {what} {how}')

    def start_fault(self, text: str) -> None:
        try:
            self._press(action(f'fault {text}'), f'fault: {text}')
        except UsageError as error:
            raise RequestError(str(error)) from error

    def clear_faults(self) -> None:
        self._press(action('fault clear'), 'faults cleared')

    def set_input(self, index: int, value: int) -> None:
        text = f'input {index}: {"on" if value else "off"}'
        self._press(action(f'io DI {index} {value}'), text)

    def _press(self, command: Action, text: str) -> None:
        if self._pendant is None:
            raise NotSimulatedError('no simulated controller found')

        def say(why: str, done: bool) -> None:
            self.robot.log(text if done else f'{text}: refused: {why}', INFO if done else WARN)

        self._pendant.press(command, say)
