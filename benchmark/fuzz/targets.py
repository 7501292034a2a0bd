# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The targets of the fuzzer, and each target's share of all inputs."""

from typing import Protocol

from benchmark.fuzz.cases import Case
from benchmark.fuzz.controller_target import ControllerTarget
from benchmark.fuzz.decode_target import DecodeTarget
from benchmark.fuzz.driver_target import DriverTarget
from benchmark.fuzz.messages import Chance
from benchmark.fuzz.remote_client_target import RemoteClientTarget


class Target(Protocol):
    """A target of the fuzzer."""

    name: str

    def case(self, chance: Chance, corpus: list[bytes]) -> Case:
        """Return a new case, determined by the random generator and the corpus."""

    def run(self, case: Case) -> None:
        """Run the case. Raises an exception if a check fails."""


MESSAGES = ('motion', 'state', 'io')


def in_process() -> dict[Target, float]:
    """Return the targets within this process, with their shares of the inputs."""
    targets: dict[Target, float] = {DecodeTarget(): 20.0, RemoteClientTarget(): 4.0}
    for armed in (False, True):
        for name in ('simulated', 'generic', 'fanuc', 'abb', 'motoman'):
            targets[ControllerTarget(name, MESSAGES, armed=armed)] = 3.0
        targets[ControllerTarget('spel', MESSAGES, armed=armed)] = 1.0
    targets[ControllerTarget('simulated', ('motion', 'state'), armed=True, smooth=True)] = 1.0
    targets[ControllerTarget('rc700a', ('remote',), armed=False)] = 6.0
    targets[ControllerTarget('rc700a', ('remote', *MESSAGES), armed=True)] = 4.0
    targets[ControllerTarget('spel', ('remote', *MESSAGES), armed=True)] = 1.0
    for name in ('simulated', 'abb', 'motoman'):
        for used in (False, True):
            targets[DriverTarget(name, used=used)] = 3.0
    return targets
