# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One interface for tests of the motion port, in the built-in program and the SPEL+ program."""

import struct
from dataclasses import replace
from typing import Any

from epson_driver.profiles.profile import load_controller_profile
from epson_driver.simple_message import ByteOrder
from support.controller_harness import LIMITS, SUCCESS, Harness, InlinePlanner, frame, split
from support.spel_program_harness import OurProgramHarness

BUILT_IN = {'smooth': 'simulated', 'ptp': 'simulated', 'fanuc': 'fanuc', 'abb': 'abb'}
"""Profile of each kind of the built-in program."""
PROFILES = {
    kind: load_controller_profile(name) for kind, name in {**BUILT_IN, 'spel': 'spel'}.items()
}
PENDING_LIMIT = 20


class MotionServer:
    """A program with one client, at the joint position 0, motors on."""

    take: Any
    """Returns the bytes sent to the client since the last call."""
    send: Any
    """Sends frames and lets the program read them."""
    limit_tolerance = 0.0
    """Accepted distance beyond a limit in addition to the rounding to float32, rad."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.profile = PROFILES[kind]

    def answers(self) -> list[tuple[int | None, int]]:
        """Return (sequence, reply code) of the replies to points since the last call."""
        return [
            (struct.unpack_from('<i', body)[0] if body else None, code)
            for msg_type, _, code, body in split(self.take())
            if msg_type != 1
        ]

    def assert_answers(self, *expected: tuple[int, int]) -> None:
        """Assert the replies since the last call, without sequences if the form has none."""
        assert self.answers() == self.numbered(*expected)

    def numbered(self, *pairs: tuple[int, int]) -> list[tuple[int | None, int]]:
        """Return the pairs, without sequences if the form of a reply has none."""
        numbered = self.profile.program.reply == 'sequence'
        return [(sequence if numbered else None, code) for sequence, code in pairs]

    def reply(self, sequence: int, code: int = SUCCESS) -> bytes:
        """Return the reply to a point."""
        if self.profile.program.reply == 'header':
            return frame(11, 3, code)
        return frame(10, 3, code, struct.pack('<i', sequence) + bytes(40))


class BuiltIn(MotionServer):
    """The built-in program, little-endian and without lag or dead times."""

    def __init__(self, kind: str) -> None:
        super().__init__(kind)
        profile = self.profile
        profile = replace(
            profile,
            byte_order=ByteOrder.LITTLE,
            motion=replace(profile.motion, statement_overhead=0.0, pending_limit=PENDING_LIMIT),
            servo=replace(profile.servo, lag=0.0, encoder=False),
            program=replace(
                profile.program, download=replace(profile.program.download, dead_time=0.0)
            ),
        )
        planner = InlinePlanner() if kind == 'smooth' else None
        self.harness = Harness(profile=profile, planner=planner)
        self.pending_limit = PENDING_LIMIT
        self.run, self.rest, self.do = self.harness.step, self.harness.rest, self.harness.do
        self.send, self.take = self.harness.send, self.harness.peer.take

    @property
    def joints(self) -> Any:
        """The joint positions, rad."""
        return self.harness.joints

    @property
    def moving(self) -> bool:
        """Whether the arm moves."""
        return self.harness.controller.in_motion

    @property
    def error(self) -> int:
        """The error number in STATUS."""
        return self.harness.error

    def next_client(self) -> None:
        """Replace the client and enable the arm."""
        self.harness.disconnect()
        self.harness.connect()
        self.do('motors on')


class SpelServer(MotionServer):
    """The SPEL+ program of the profile `spel`."""

    limit_tolerance = 2e-5
    pending_limit = 250

    def __init__(self) -> None:
        super().__init__('spel')
        self.harness = OurProgramHarness()
        self.client = self.harness.ready()
        self.run, self.rest = self.harness.step, self.harness.rest
        self.send, self.take = self._send, self.client.raw

    @property
    def joints(self) -> Any:
        """The joint positions, rad."""
        return self.harness.position

    @property
    def moving(self) -> bool:
        """Whether the arm moves."""
        return self.harness.controller.in_motion

    @property
    def error(self) -> Any:
        """The error number of the last refused point."""
        return self.harness.variable('g_point_error')

    def _send(self, *frames: bytes) -> None:
        for data in frames:
            self.client.send_bytes(data)
            self.run(0.01)
        self.run(0.02)

    def do(self, *events: str) -> None:
        """Apply the events of an operator."""
        self.harness.do(*events)
        self.run(0.1)

    def next_client(self) -> None:
        """Replace the client and enable the arm."""
        self.client.leave()
        self.client = self.harness.ready()
        self.take = self.client.raw


def motion_server(kind: str) -> Any:
    """Return a program of a kind with a client."""
    return SpelServer() if kind == 'spel' else BuiltIn(kind)


__all__ = ['LIMITS', 'PROFILES', 'motion_server']
