# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What kind of arm it is, as Remote Ethernet and SPEL+ tell it."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.controller_harness import Remote

from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model, robot_models
from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.remote.robot_type import robot_type


@pytest.mark.parametrize(
    ('name', 'number'),
    [('c8_c901s', 5), ('t6_602s', 3), ('gx8_c652sr', 3), ('rs6_c552s', 6), ('n2_a450s', 7)],
)
def test_remote_ethernet_and_spel_have_the_same_number(name: str, number: int) -> None:
    model = load_robot_model(name)
    start = np.zeros(len(model.joint_names))
    controller = new_controller(model, load_controller_profile('rc700a'), start)
    remote = Remote(SimpleNamespace(controller=controller))
    assert remote('GetRobotInfo') == f'#GetRobotInfo,1,{number},{name.upper().replace("_", "-")}'
    assert remote('Sim,print,RobotType') == f'#Sim,{number}'


def test_the_number_is_that_of_the_series() -> None:
    series = {'rs3': 6, 'rs4': 6, 'rs6': 6, 'n2': 7}
    for name in robot_models():
        model = load_robot_model(name)
        usual = 3 if model.kind == 'SCARA' else 5
        assert robot_type(model) == series.get(name.partition('_')[0], usual)
