# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The jaws of a pneumatic gripper, wired to the points of a simulated controller."""

from epson_driver.simple_message import IoType

DI, DO = IoType.DIGITAL_INPUT, IoType.DIGITAL_OUTPUT


class TwoJaws:
    """Jaws that start closed. An output that switches on moves them to its end in `travel` s.

    `part`: an object prevents closing. `stuck`: they do not move. `seen`: both outputs, open and
    close, at each change.
    """

    def __init__(self, controller, wiring, *, travel=0.3):
        self.travel = travel
        self.part = False
        self.stuck = False
        self.seen = []
        self._controller = controller
        self._wiring = wiring
        self._timer = None
        self._points = controller.io
        self._show(False, True)
        self._before = self._outputs()
        self._points.listen(self._changed)

    def _outputs(self):
        wiring = self._wiring
        return tuple(
            bool(self._points.read(DO, index))
            for index in (wiring.open_output, wiring.close_output)
        )

    def _changed(self):
        outputs, before = self._outputs(), self._before
        self._before = outputs
        if outputs == before:
            return
        self.seen.append(outputs)
        if self.stuck or outputs not in ((True, False), (False, True)):
            return
        if self._timer is not None:
            self._timer.cancel()
        opens = outputs[0]
        end = self._wiring.opened_input if opens else self._wiring.closed_input
        if self._points.read(DI, end):
            return
        self._show(False, False)
        if opens or not self.part:
            self._timer = self._controller.clock.after(
                self.travel, lambda: self._show(opens, not opens)
            )

    def _show(self, opened, closed):
        self._points.set_input(DI, self._wiring.opened_input, int(opened))
        self._points.set_input(DI, self._wiring.closed_input, int(closed))
