# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One robot's part of the page: what all browsers see, and the controls of each browser.

What is shown is shared. What moves the arm belongs to one connection, whose clicks reach nobody
else's controls; a click is judged again when it comes (`robot_control.py`), whatever the page
showed.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import viser

from epson_driver.motion import Array, Trajectory
from epson_driver.panel import page_html
from epson_driver.panel.lamps import advice, lamps
from epson_driver.panel.plots import COLOURS, SPAN_S, History
from epson_driver.panel.robot_control import PENDANT, RobotControl
from epson_driver.panel.robot_state import RequestError
from epson_driver.panel.scene import ArmScene
from epson_driver.robots import RobotModel
from epson_driver.sim_controller.faults.fault_kinds import FAULTS

REFERENCE_LASTS_S = 0.5
"""So long after the last ~/controller_state (20 Hz) a trajectory counts as being executed, s."""

SHOWN_UNITS = {'rad': '°', 'm': ' mm'}

MAX_OUTPUTS = 16
OUTPUT, INPUT = 2, 1
"""Types of epson_msgs/IoPoint."""

PLOT_HEIGHT_PX = 118

MIN_RANGE = (-0.1, 0.1)
"""What a plot shows at least, in its unit."""


class RobotPage:
    """What all browsers see of a robot. All methods in the panel's own thread."""

    def __init__(
        self,
        viewer: viser.ViserServer,
        control: RobotControl,
        trajectories: Mapping[str, Trajectory],
        tabs: tuple[Any, Any],
        place: Array,
        label: str,
    ) -> None:
        self.control = control
        self.trajectories = trajectories
        self._viewer = viewer
        self._place, self._label = place, label
        self._state = control.robot.state
        self._scene: ArmScene | None = None
        self._model: RobotModel | None = None
        self._history = History(np.zeros(0))
        self._units: tuple[str, ...] = ()
        self._per_unit: Array = np.zeros(0)
        self._plan: Trajectory | None = None
        self._executing = False
        self._beat = 0
        self.right, self._left = tabs
        gui = viewer.gui
        with self.right:
            gui.add_html(page_html.STYLE, order=-1)
            self._lamps = gui.add_html('', order=0)
            self.stop_one = gui.add_button(
                'Stop this robot', color='red', icon=viser.Icon.HAND_STOP, order=10, visible=False
            )
            self.stop_one.on_click(self._always(control.stop))
            disable = gui.add_button('Disable', color='gray', order=11)
            disable.on_click(self._always(control.disable))
            self.io_folder = gui.add_folder('I/O', order=40, expand_by_default=False)
            with self.io_folder:
                self._io = gui.add_html('', order=0)
        with self._left:
            gui.add_html(page_html.STYLE, order=-1)
            self._joints = gui.add_html('', order=0)
            self._log = gui.add_html('', order=1000)
        self._curves: list[Any] = []

    def _always(self, action: Callable[[], object]) -> Callable[[Any], None]:
        def on_click(event: Any) -> None:
            attempt(event.client, self.control, action)

        return on_click

    # --- drawing ----------------------------------------------------------------------------

    def draw_pose(self, now: float) -> None:
        """Draw the arm where it is, and the ghost of the plan."""
        state = self._state
        self._take_over_model()
        if self._scene is None or not self._fits(state.positions):
            return
        self._scene.grey(not state.fresh('joints', now))
        self._scene.show(state.positions)
        age = state.age('reference', now)
        executing = age is not None and age < REFERENCE_LASTS_S
        if self.control.plan is not self._plan:
            self._plan = self.control.plan
            self._scene.show_plan(self._plan)
        elif executing and not self._executing and not self.control.robot.goals:
            self._scene.show_plan(None)  # somebody else's goal: its way is not known
        self._executing = executing
        self._scene.show_ghost(state.reference if executing else None)

    def remember(self, now: float) -> None:
        """Add what was measured to the curves."""
        state = self._state
        if self._fits(state.positions) and state.fresh('joints', now):
            error = state.tracking_error if self._executing else None
            self._history.add(now, state.positions, state.velocities, error)

    def draw_text(self, now: float) -> None:
        """Draw lamps, joints, I/O and log."""
        state = self._state
        ages = [
            (name, state.age(key, now))
            for name, key in (
                ('joints', 'joints'),
                ('status', 'status'),
                ('driver', 'diagnostics'),
            )
        ]
        self._lamps.content = page_html.lamps_html(
            lamps(state, now), advice(state, now), ages, self._beat
        )
        self._io.content = page_html.io_html(state.io, state.io_reason)
        self._log.content = page_html.log_html(state.events)
        if self._model is not None and self._fits(state.positions):
            limits = self._model.limits
            self._joints.content = page_html.joints_html(
                state.joint_names,
                state.positions,
                limits.position_min,
                limits.position_max,
                self._per_unit,
                self._units,
                state.fresh('joints', now),
            )

    def draw_curves(self, now: float) -> None:
        """Draw the curves, and the path that the tool has driven."""
        for curve, data in zip(self._curves, self._history.curves(now), strict=False):
            if len(data[0]) >= 2:
                curve.data = (*data, *(np.full(len(data[0]), value) for value in MIN_RANGE))
        if self._scene is not None:
            self._scene.show_path()

    def beat(self) -> None:
        """Show the browsers that the panel lives: without it they grey what they show."""
        self._beat += 1

    def _fits(self, positions: Array) -> bool:
        return self._model is not None and len(positions) == len(self._model.joint_names)

    def _take_over_model(self) -> None:
        model = self.control.model
        if model is self._model:
            return
        self._model, self._scene = model, None
        path = f'/robots/{self.control.robot.name.strip("/").replace("/", "_")}'
        self._viewer.scene.remove_by_name(path)
        if model is None:
            self._joints.content = ''
            return
        self._scene = ArmScene(self._viewer, path, model, self._place, self._label)
        self._per_unit = model.shown_per_unit
        self._units = tuple(SHOWN_UNITS[unit] for unit in model.limits.units)
        self._history = History(self._per_unit)
        for curve in self._curves:
            curve.remove()
        unit = ', '.join(sorted({each.strip() for each in self._units}))
        with self._left:
            self._curves = [
                _curve(self._viewer, f'{name} [{suffix.replace("#", unit)}]', len(self._units))
                for name, suffix in (
                    ('Position', '#'),
                    ('Velocity', '#/s'),
                    ('Plan − measured', '#'),
                )
            ]


def _curve(viewer: viser.ViserServer, title: str, count: int) -> Any:
    """Add a plot of so many curves, and of MIN_RANGE, which nobody sees."""
    times = np.array([-SPAN_S, 0.0])
    series: list[Any] = [{'label': 's'}]
    series += [
        {'label': f'{index + 1}', 'stroke': COLOURS[index % len(COLOURS)], 'width': 1.4}
        for index in range(count)
    ]
    series += [{'label': '', 'stroke': 'transparent', 'width': 0}] * len(MIN_RANGE)
    axis: Any = {
        'font': '11px sans-serif',
        'stroke': '#868e96',
        'size': 24,
        'grid': {'stroke': '#eef0f2', 'width': 1},
    }
    return viewer.gui.add_uplot(
        (times, *[np.zeros(2)] * (count + len(MIN_RANGE))),
        tuple(series),
        title=title,
        scales={'x': {'time': False}},
        axes=(axis, axis | {'size': 46}),
        legend={'show': False},
        height=PLOT_HEIGHT_PX,
        padding=(4, 12, 0, 0),
    )


class BrowserControls:
    """The controls of one browser for one robot."""

    def __init__(self, page: RobotPage, client: viser.ClientHandle) -> None:
        self._page = page
        self._control = control = page.control
        self._client = client
        self._browser = browser = client.client_id
        self._trajectories = page.trajectories
        self._simulated: bool | None = None
        self._outputs: Any = None
        self._output_names: tuple[str, ...] = ()
        self._pendant: Any = None
        gui = client.gui
        with page.right:
            self._arm = gui.add_button(
                'Arm',
                color='orange',
                icon=viser.Icon.LOCK_OPEN,
                order=20,
                hint='What moves the robot is off until this window is armed. It ends with it.',
            )
            self._disarm = gui.add_button(
                'Disarm', color='dark', icon=viser.Icon.LOCK, order=21, visible=False
            )
            motion = gui.add_folder('Motion', order=30)
            with motion:
                off: Any = {'disabled': True}  # from the first moment on
                enable = gui.add_button(
                    'Enable', color='green', icon=viser.Icon.POWER, order=1, **off
                )
                reset = gui.add_button('Reset error', color='gray', order=2, **off)
                self._speed: Any = gui.add_slider('Speed [%]', 0, 100, 1, 100, order=3, **off)
                self._chosen = gui.add_dropdown('Trajectory', self._offered(), order=4)
                go = gui.add_button('Go to its start, slowly', color='gray', order=5, **off)
                execute = gui.add_button(
                    'Execute', color='blue', icon=viser.Icon.PLAYER_PLAY, order=6, **off
                )
        self._arm.on_click(self._do(partial(control.arming.arm, browser)))
        self._disarm.on_click(self._do(partial(control.arming.disarm, 'by hand', browser)))
        self._motion = [enable, reset, self._speed, go, execute]
        enable.on_click(self._do(partial(control.enable, browser)))
        reset.on_click(self._do(partial(control.reset_error, browser)))
        self._speed.on_update(self._on_speed)
        go.on_click(self._do(self._go_to_start))
        execute.on_click(self._do(self._execute))

    def refresh(self) -> None:
        """Show what is possible now."""
        armed = self._control.arming.holder == self._browser
        self._arm.visible, self._disarm.visible = not armed, armed
        for each in self._motion:
            each.disabled = not armed
        if (offered := self._offered()) != tuple(self._chosen.options):
            self._chosen.options = offered
        speed = self._page.control.robot.state.speed
        if speed is not None and not armed and self._speed.value != round(100 * speed):
            self._speed.value = round(100 * speed)
        self._refresh_outputs(armed)
        if self._control.simulated != self._simulated:
            self._simulated = self._control.simulated
            self._rebuild_pendant()

    def _offered(self) -> tuple[str, ...]:
        """Return the trajectories for as many joints as the robot has, if that is known."""
        joints = len(self._page.control.robot.state.joint_names)
        return tuple(
            name
            for name, each in self._trajectories.items()
            if joints in (0, len(each.joint_names))
        ) or ('none',)

    # --- what a person does: these run in viser's threads -----------------------------------

    def _do(self, action: Callable[[], object]) -> Callable[[Any], None]:
        def on_click(_event: Any) -> None:
            attempt(self._client, self._control, action)

        return on_click

    def _on_speed(self, event: Any) -> None:
        if event.client_id is not None:  # a person's change, not that of `refresh`
            factor = self._speed.value / 100.0
            action = partial(self._control.set_speed, self._browser, factor)
            attempt(self._client, self._control, action)

    def _execute(self) -> None:
        name, trajectory = self._trajectory()
        if away := self._control.away_from_start(trajectory):
            raise RequestError(f'{away} from the start of {name}: go there first')
        self._control.execute(self._browser, name, trajectory)

    def _go_to_start(self) -> None:
        self._control.go_to_start(self._browser, *self._trajectory())

    def _trajectory(self) -> tuple[str, Trajectory]:
        name = self._chosen.value
        if name not in self._trajectories:
            raise RequestError('there is no trajectory to execute')
        return name, self._trajectories[name]

    # --- outputs and the simulated pendant --------------------------------------------------

    def _refresh_outputs(self, armed: bool) -> None:
        state = self._control.robot.state
        names = tuple(
            str(each.start + index)
            for each in state.io
            if each.type == OUTPUT
            for index in range(len(each.values))
        )[:MAX_OUTPUTS]
        if names != self._output_names:
            self._output_names = names
            if self._outputs is not None:
                self._outputs.remove()
                self._outputs = None
            if names:
                with self._page.io_folder:
                    self._outputs = self._client.gui.add_button_group(
                        'Switch output', names, order=1
                    )
                self._outputs.on_click(
                    lambda event: attempt(
                        self._client,
                        self._control,
                        partial(self._switch, int(event.target.value), OUTPUT),
                    )
                )
        if self._outputs is not None:
            self._outputs.visible = armed  # viser cannot disable it

    def _switch(self, index: int, kind: int) -> None:
        state = self._control.robot.state
        if state.io_reason:
            raise RequestError(f'I/O is not known: {state.io_reason}')
        for each in state.io:
            if each.type == kind and 0 <= index - each.start < len(each.values):
                value = 0 if each.values[index - each.start] else 1
                if kind == OUTPUT:
                    self._control.write_output(self._browser, index, value)
                else:
                    self._control.set_input(index, value)
                return
        raise RequestError(f'there is no point {index}')

    def _rebuild_pendant(self) -> None:
        if self._pendant is not None:
            self._pendant.remove()
            self._pendant = None
        if not self._simulated:
            return
        gui, control = self._client.gui, self._control
        with self._page.right:
            self._pendant = gui.add_folder('Simulated pendant', order=50)
        with self._pendant:
            for what, ways in PENDANT.items():
                group = gui.add_button_group(what, tuple(ways))
                group.on_click(partial(self._on_press, what))
            number = gui.add_number('Input', 0, min=0, max=255, step=1)
            switch = gui.add_button('Switch this input', color='gray')
            switch.on_click(self._do(lambda: self._switch(int(number.value), INPUT)))
            kind = gui.add_dropdown('Fault', tuple(FAULTS))
            details = gui.add_text('Details', '', hint='such as for=3 port=state')
            start = gui.add_button('Start this fault', color='orange')
            start.on_click(
                self._do(lambda: control.start_fault(f'{kind.value} {details.value}'.strip()))
            )
            clear = gui.add_button('Clear all faults', color='gray')
            clear.on_click(self._do(control.clear_faults))

    def _on_press(self, what: str, event: Any) -> None:
        how = event.target.value
        if how in PENDANT[what]:
            action = partial(self._control.press, self._browser, what, how)
            attempt(self._client, self._control, action)


def attempt(client: Any, control: RobotControl, action: Callable[[], object]) -> None:
    """Do what a person asked for, or say in that window and in the log why not.

    viser would only print what a button raised.
    """
    try:
        action()
    except RequestError as error:
        control.robot.log(f'not done: {error}', 30)
        if client is not None:
            client.add_notification('Not done', str(error), color='red', auto_close_seconds=8.0)
    except BaseException as error:  # noqa: BLE001 - it is told, and ends the panel
        control.on_error('what a button does failed', error)
