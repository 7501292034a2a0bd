# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""variants/lerobot_robot_epson in virtual time, with stand-ins for lerobot.

Virtual time makes the stopping times independent of the machine. The variant's tests use the
genuine lerobot.
"""

import asyncio
import contextlib
import importlib
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from support.api_harness import robot_cell
from support.event_loop import now

from epson_driver import Settings

VARIANT = Path(__file__).parents[2] / 'variants' / 'lerobot_robot_epson'
RATE = 30.0
MOVING = 0.01
REST_S = 0.3


class Registered:
    """A configuration class of lerobot."""

    @classmethod
    def register_subclass(cls, _name):
        return lambda kind: kind


class Device:
    """A robot or a teleoperator of lerobot."""

    def __init__(self, config):
        pass


STAND_INS = {
    'lerobot': {},
    'lerobot.cameras': {'CameraConfig': object, 'make_cameras_from_configs': lambda _: {}},
    'lerobot.robots': {'RobotConfig': Registered, 'Robot': Device},
    'lerobot.teleoperators': {'TeleoperatorConfig': Registered, 'Teleoperator': Device},
    'lerobot.teleoperators.keyboard': {'KeyboardTeleop': Device, 'KeyboardTeleopConfig': object},
    'lerobot.utils': {},
    'lerobot.utils.decorators': {
        'check_if_not_connected': lambda function: function,
        'check_if_already_connected': lambda function: function,
    },
    'lerobot.lerobot_types': {'RobotAction': dict, 'RobotObservation': dict},
}


@pytest.fixture
def variant(monkeypatch):
    monkeypatch.syspath_prepend(str(VARIANT))
    for name, values in STAND_INS.items():
        module = ModuleType(name)
        vars(module).update(values)
        monkeypatch.setitem(sys.modules, name, module)
    try:
        robot = importlib.import_module('lerobot_robot_epson.epson_robot')
        monkeypatch.setattr(robot, 'time', SimpleNamespace(perf_counter=now))
        yield importlib.import_module('lerobot_robot_epson')
    finally:
        for name in [item for item in sys.modules if item.startswith('lerobot_robot_epson')]:
            del sys.modules[name]


def far(_step, count):
    return np.full(count, 3.0)


def to_and_fro(step, count):
    return np.full(count, 3.0 if step // 10 % 2 else -3.0)


def against_each_other(step, count):
    return np.where(np.arange(count) % 2, 3.0, -3.0) * (1.0 if step // 7 % 2 else -1.0)


def anything(step, count):
    action = np.random.default_rng(step).uniform(-3.0, 3.0, count)
    return np.where(np.arange(count) == step % 9, np.nan, action)


@pytest.mark.invariant(2)
@pytest.mark.parametrize(
    ('model', 'policy', 'counts'),
    [
        ('gx8_c652s', far, (40, 47)),
        *(
            pytest.param(*values, marks=pytest.mark.slow)
            for values in (
                ('c3_a601s', far, (40, 47)),
                ('cx7_a901s', far, (40, 47)),
                ('vt6_a901s', far, (40, 47)),
                ('c3_a601s', anything, (40, 47)),
                # the actions end just after a reversal, while the speed rises
                ('vt6_a901s', to_and_fro, (42, 47, 52)),
                ('c3_a601s', against_each_other, (40, 52)),
            )
        ),
    ],
)
async def test_hostile_actions_exceed_no_limit_and_the_arm_stops_soon(
    variant, model, policy, counts
):
    config = variant.EpsonRobotConfig(model=model)
    settings = Settings(servo_scale=config.acceleration, servo_timeout=config.timeout)
    async with robot_cell(model=model, smooth=True, settings=settings) as (arm, _):
        robot, seen = variant.EpsonRobot(config), []
        robot.arm = arm
        arm.on_joints(lambda sample: seen.append((now(), sample)))
        for count in counts:
            for step in range(count):
                with contextlib.suppress(ValueError):
                    action = policy(step, len(robot.limits.names)).tolist()
                    robot.send_action(dict(zip(robot.action_features, action, strict=True)))
                    last = now()
                await asyncio.sleep(1.0 / RATE)
            await asyncio.sleep(1.2)
            moving = [time for time, sample in seen if np.abs(sample.velocities).max() > MOVING]
            assert max(moving) - last < REST_S
        limits = robot.limits
        fastest = max(
            float((np.abs(sample.velocities) / limits.velocity).max()) for _, sample in seen
        )
        assert 0.002 < fastest < 0.12
        for _, sample in seen:
            assert (sample.positions > limits.position_min - 1e-6).all()
            assert (sample.positions < limits.position_max + 1e-6).all()
