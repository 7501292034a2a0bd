# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What SPEL+ says of a joint in millimetres: a SCARA's joint 3."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.remote_harness import Remote

from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.condition.states import RejectedError

MODEL = load_robot_model('gx4_c251s')
START = np.array([0.5, -0.25, -0.05, 1.0])


@pytest.fixture
def remote() -> Remote:
    controller = new_controller(MODEL, load_controller_profile('rc700a'), START)
    return Remote(SimpleNamespace(controller=controller))


def test_agl_is_in_mm_and_pls_in_pulses_per_mm(remote: Remote) -> None:
    assert remote('Sim,print,Agl(1),Agl(3)') == '#Sim,28.648 -50.000'
    # 131072 pulses in 11.52 mm
    assert remote('Sim,print,Pls(3)') == f'#Sim,{round(-50.0 * 131072 / 11.52)}'


def test_home_is_held_against_the_stroke(remote: Remote) -> None:
    assert remote('Execute,"HomeSet 0,0,-1706666,0"') == '#Execute,0'
    assert remote('Execute,"HomeSet 0,0,-1706669,0"') == '!Execute,15'
    assert 'HomeSet joint 3' in remote('Sim,why')


def test_a_push_is_in_mm(remote: Remote) -> None:
    assert remote('Sim,disturb,3,-10') == '#Sim,0'
    assert remote.controller.joint_position().joints[2] == pytest.approx(-0.06, abs=1e-7)
    with pytest.raises(
        RejectedError, match=r'joint_3 = 0\.04 m is outside the limits -0\.15 … 0 m'
    ):
        remote.controller.disturb(2, 0.1)
