# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A simulated controller with its driver as a pytest fixture, for the tests of other packages.

In their conftest.py: `pytest_plugins = ['epson_driver.exercise.pytest_plugin']`.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

from epson_driver.exercise.cell import SimulatedCell, simulated_cell

MARKER = (
    'sim_controller(robot, controller, arguments, parameters, enabled): arguments of the fixture '
    'sim_controller'
)


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line('markers', MARKER)


@pytest.fixture
def sim_controller(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[SimulatedCell]:
    """Run a simulated controller and the driver in a free ROS domain.

    The environment of the test is set to that domain, for rclpy in the test and for its child
    processes. `@pytest.mark.sim_controller(controller='spel', enabled=False)` sets arguments of
    `simulated_cell`.
    """
    marker = request.node.get_closest_marker('sim_controller')
    options = dict(marker.kwargs) if marker is not None else {}
    folder = tmp_path / 'cell'
    folder.mkdir()
    with simulated_cell(folder, **options) as cell:
        for name in ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE'):
            monkeypatch.setenv(name, cell.environment[name])
        yield cell
