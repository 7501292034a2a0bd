# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the old client did wrong: the list in docs/migration.md, each item with its tests.

The tests at the end are those of rows that no other file had a test for.
"""

import ast
import dataclasses
import re
import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support.driver_harness import (
    HOME,
    LIMITS,
    Harness,
    ScriptedController,
    frame,
    open_gate,
    pose,
)
from support.event_loop import until
from support.pages import items, unwrapped

from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.delivery.trajectory_points import (
    FIRST_POINT_VELOCITY_FRACTION,
    trajectory_points,
)
from epson_driver.driver.state.joint_mapping import unmapped
from epson_driver.motion import Trajectory
from epson_driver.node.parameters import TABLE as PARAMETERS
from epson_driver.node.parameters import declare
from epson_driver.processes.executables import EXECUTABLES
from epson_driver.profiles import load_controller_profile
from epson_driver.simple_message import ByteOrder, JointTrajPt

TESTS = Path(__file__).parents[1]
PAGE = TESTS.parent / 'docs' / 'migration.md'
SECTION = (
    PAGE.read_text(encoding='utf-8')
    .split(': known defects of the old client\n')[1]
    .split('\n## ')[0]
)
DEFECTS = [name for name, _ in (item.split(': ', 1) for item, _ in items(SECTION))]

SHOWN_BY: tuple[tuple[str, str], ...] = (
    ('B1', 'test_b1_a_frame_of_4000_bytes_is_left_out_and_the_next_one_taken'),
    ('B2', 'test_b2_a_wrong_byte_order_ends_the_connection_and_says_why'),
    ('B3', 'test_whatever_ends_the_connection_the_next_one_works'),
    (
        'B4',
        'test_small_frames_are_not_delayed_and_a_vanished_peer_is_noticed '
        'test_inv7_a_peer_that_asks_and_never_reads_fills_no_memory',
    ),
    ('B5', 'test_b5_a_message_cannot_be_changed'),
    ('#25', 'test_a_bad_frame_is_counted_by_its_field_and_the_connection_kept'),
    ('#28, #32', 'test_feedback_messages_are_joints_too'),
    ('#111', 'test_requests_to_the_client_are_answered'),
    ('#114', 'test_a_path_that_ends_where_it_began_does_not_succeed_early'),
    ('#118', 'test_a_failure_reply_ends_the_goal_with_the_controllers_error'),
    (
        '#124, #125',
        'test_points_go_one_at_a_time_and_the_goal_succeeds_when_the_arm_stands_there',
    ),
    ('#131', 'test_inv5_every_goal_ends_while_states_come'),
    ('#147', 'test_147_more_than_ten_joints_are_refused_with_the_name_of_the_parameter'),
    ('#154', 'test_a_goal_where_the_arm_stands_already_succeeds'),
    (
        '#174',
        'test_disable_stops_the_arm_then_switches_the_motors_off '
        'test_enable_and_disable_switch_a_motomans_servos '
        'test_inv4_a_goal_before_enable_is_refused_and_nothing_is_sent',
    ),
    (
        '#175, #260',
        'test_stop_without_a_goal_is_acknowledged_by_the_controller '
        'test_stop_that_the_controller_does_not_obey',
    ),
    ('#187', 'test_bad_goal_is_refused_with_its_reason_and_nothing_moves'),
    ('#191', 'test_191_the_first_point_leaves_at_once'),
    (
        '#210, #216',
        'test_a_replacement_that_fits_where_the_arm_stops_is_executed '
        'test_the_newest_of_several_goals_is_executed',
    ),
    (
        '#218',
        'test_joints_are_counted_as_ros_does_in_both_directions '
        'test_sign_and_offset_come_after_the_coupling '
        'test_there_and_back_is_the_same',
    ),
    (
        '#235',
        'test_velocity_is_the_fraction_the_segment_needs '
        'test_velocities_of_the_plan_count_at_both_ends_of_a_segment',
    ),
    (
        '#238, #239, #263, fanuc_experimental#17',
        'test_a_link_that_was_lost_after_a_while_comes_back_at_once '
        'test_back_off_begins_at_once_never_shrinks_and_is_at_most_a_second',
    ),
    (
        '#265',
        'test_inv4_inv6_a_killed_controller_that_comes_back_moves_nothing '
        'test_a_request_is_forgotten_when_the_link_is_lost',
    ),
    (
        '#83, #271',
        'test_271_a_status_alone_ends_the_goal_and_closes_the_gate '
        'test_inv4_an_estop_ends_the_goal_at_once_and_the_gate_stays_closed '
        'test_motors_off_end_the_goal_and_a_waiting_one',
    ),
    (
        '#282, motoman#88, motoman#215',
        'test_a_stream_of_positions_is_followed_to_its_last_one_and_then_a_goal_runs '
        'test_a_stream_of_single_points_ends_every_goal_and_leaves_the_arm_at_rest '
        'test_a_stream_of_single_points_is_noticed_once',
    ),
    (
        '#27, motoman#361, staubli#12',
        'test_values_are_told_at_first_and_when_one_changes '
        'test_reading_and_writing_points_and_groups',
    ),
    (
        'staubli#26',
        'test_success_needs_every_reply '
        'test_success_waits_while_the_controller_says_that_it_moves',
    ),
    (
        'motoman#174',
        'test_velocity_of_a_constant_motion_is_exact '
        'test_measured_velocities_are_taken_as_they_are',
    ),
    ('motoman#228', 'test_motoman_228_a_trajectory_without_a_joint_state_is_refused'),
    ('motoman#591', 'test_every_parameter_has_a_description_a_type_and_bounds'),
    ('fanuc_experimental#9', 'test_fanuc_9_a_plan_without_velocities_moves_as_fast_as_planned'),
    (
        'packet-simplemessage#21',
        'test_one_byte_per_segment test_any_segmentation_gives_the_same_frames',
    ),
    (
        'observed',
        'test_durations_of_less_than_a_second_are_exact '
        'test_a_first_point_without_time_gets_the_usual_velocity_and_a_duration_above_zero',
    ),
    ('observed', 'test_a_reply_that_does_not_come_ends_the_goal'),
    ('observed', 'test_cancel_sends_stop_at_once_and_ends_when_the_arm_stands'),
    (
        'observed',
        'test_a_silent_state_link_is_lost_after_its_timeout '
        'test_a_status_that_stops_closes_the_gate_and_is_said_to_be_unknown',
    ),
    ('observed', 'test_requests_to_the_client_are_answered'),
    (
        'observed',
        'test_zero_is_the_default_and_negative_is_off '
        'test_a_joint_beside_the_path_stops_the_arm_and_the_text_says_which '
        'test_goal_time_ends_a_goal_that_takes_too_long',
    ),
    (
        'observed',
        'test_feedback_is_where_it_should_go_where_it_is_and_the_difference '
        'test_action_send_goal_finds_the_type_by_its_name_and_gets_feedback_and_a_result',
    ),
    ('observed', 'test_cancel_brings_the_arm_to_rest'),
    (
        'observed',
        'test_a_position_beyond_its_limit_names_joint_value_and_limit '
        'test_numbers_that_are_not_finite '
        'test_times_must_increase',
    ),
    ('observed', 'test_stop_that_the_controller_does_not_obey test_stop_without_a_link'),
    (
        'motoman#41',
        'test_inv5_a_goal_ends_once_with_an_outcome_that_fits_its_state '
        'test_a_result_carries_code_and_text',
    ),
    ('observed', 'test_an_arm_that_rests_beside_the_goal_names_joint_distance_and_tolerance'),
    (
        'observed',
        'test_a_download_that_is_too_long_is_refused_before_anything_is_sent '
        'test_a_lost_link_in_the_middle',
    ),
    (
        'observed',
        'test_an_acknowledgement_that_is_taken_back_ends_the_goal test_a_late_no_ends_the_goal',
    ),
    ('observed', 'test_joint_names_must_be_there_and_differ'),
    (
        'observed',
        'test_inv3_client_interrupted_in_mid_motion_stops_the_arm_and_ends_cleanly '
        'test_ctrl_c_in_mid_motion_brakes_within_limits_and_ends_the_goal_once',
    ),
    (
        'ROS 2 ports',
        'test_a_driver_that_is_cancelled_ends_its_goal '
        'test_so_many_cuts_are_so_many_clean_outcomes',
    ),
    ('ROS 2 ports', 'test_joint_names_become_parameters_of_their_own'),
)
"""The defects of the page, in its order, and the tests that show what is here instead."""

KNOWN = {f'B{number}' for number in range(1, 6)}
KNOWN |= {
    f'#{number}'
    for number in (25, 27, 28, 32, 111, 114, 118, 124, 125, 131, 147, 154, 174, 175, 187, 191)
}
KNOWN |= {f'#{number}' for number in (83, 210, 216, 218, 235, 238, 239, 260, 263, 265, 271, 282)}
KNOWN |= {f'motoman#{number}' for number in (41, 88, 174, 215, 228, 361, 591)}
KNOWN |= {'fanuc_experimental#9', 'fanuc_experimental#17', 'staubli#12', 'staubli#26'}
KNOWN |= {'packet-simplemessage#21'}
"""Every reported defect of the old client that concerns a client."""


@pytest.fixture(scope='module')
def all_tests():
    """The names of all tests there are."""
    return {
        node.name
        for path in TESTS.rglob('test_*.py')
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }


def test_each_defect_of_the_page_is_shown_by_tests_that_exist(all_tests):
    assert [name for name, _ in SHOWN_BY] == DEFECTS
    for name, tests in SHOWN_BY:
        assert tests, name
        assert set(tests.split()) <= all_tests, name


def test_no_known_defect_is_left_out():
    found = {name.strip() for defect in DEFECTS for name in defect.split(',')}
    assert found - {'observed', 'ROS 2 ports'} == KNOWN


def names_here(title):
    """Return the names that a section of the page leads to."""
    section = PAGE.read_text('utf-8').split(f'\n## {title}\n')[1].split('\n## ')[0]
    for line in unwrapped(section).splitlines():
        if ' → ' in line:
            there, _, _ = line.split(' → ')[1].partition(' — ')
            yield from re.findall(r'`([^`]+)`', there)


@pytest.mark.parametrize('title', ['Topics, services, actions', 'Parameters'])
def test_what_the_migration_leads_to_is_there(title):
    make = runpy.run_path(str(PAGE.parent / 'make_tables.py'))
    there = (PAGE.parent / 'ros_interface.md').read_text('utf-8') + ''.join(make['parameters']())
    names = list(names_here(title))
    assert len(names) > 5
    for name in names:
        assert f'* `{name}` (' in there


def test_the_nodes_that_the_migration_leads_to_are_there():
    for name in names_here('Nodes'):
        if ': ' in name:
            parameter, value = name.split(': ')
            row = next(row for row in PARAMETERS if row.name == parameter)
            assert value in row.choices or parameter == 'controller'
        elif name not in ('motoman', 'fanuc', 'abb'):
            assert name in EXECUTABLES
    for name in ('motoman', 'fanuc', 'abb'):
        assert load_controller_profile(name).name == name


async def test_b1_a_frame_of_4000_bytes_is_left_out_and_the_next_one_taken():
    """The old library wrote it over the stack."""
    async with ScriptedController() as controller, Harness(controller.ports) as harness:
        await harness.ready()
        controller.extra = frame(10, 1, 0, bytes(4000 - 12))
        counted = harness.driver.state_link.statistics
        await until(lambda: counted.bad_frames)
        assert counted.bad_frames == {'body': 1}
        seen = len(harness.events.samples)
        await until(lambda: len(harness.events.samples) > seen + 2)
        assert counted.connections == 1


async def test_b2_a_wrong_byte_order_ends_the_connection_and_says_why():
    """The old client waited for the 939,524,096 bytes of a small message read the wrong way."""
    async with ScriptedController() as controller:  # it writes little endian
        async with Harness(controller.ports, byte_order=ByteOrder.BIG) as harness:
            await until(lambda: harness.driver.state_link.statistics.bad_frames['length'])
            await until(lambda: any('length' in why for _, why in harness.events.links))
            assert not harness.events.samples
        async with Harness(controller.ports) as harness:
            await harness.ready()


def test_b5_a_message_cannot_be_changed():
    point = JointTrajPt(1)
    with pytest.raises(dataclasses.FrozenInstanceError):
        point.sequence = 2


def test_147_more_than_ten_joints_are_refused_with_the_name_of_the_parameter():
    names = [f'joint_{number}' for number in range(1, 12)]
    node = SimpleNamespace(
        declare_parameter=lambda name, default, _descriptor: SimpleNamespace(
            value=names if name == 'joint_names' else default
        )
    )
    with pytest.raises(ValueError, match='joint_names has 11 names: a message carries 10'):
        declare(node)


async def test_191_the_first_point_leaves_at_once():
    """No timer, no sleep, no turn of the loop between the goal and its first point."""
    async with ScriptedController() as controller, Harness(controller.ports) as harness:
        await harness.ready()
        await harness.commands.enable()
        sent = harness.driver.motion_link.statistics.frames_sent
        goal = harness.submit(pose(0.1))
        assert harness.driver.motion_link.statistics.frames_sent == sent + 1
        await until(lambda: controller.received)
        assert controller.received[0] == 0
        harness.driver.goal_queue.cancel(goal.handle)
        await goal.end()


async def test_motoman_228_a_trajectory_without_a_joint_state_is_refused():
    controller = ScriptedController()
    controller.shows_joints = False
    async with controller, Harness(controller.ports) as harness:
        await until(lambda: harness.driver.robot.status is not None)
        await until(lambda: harness.driver.motion_link.connected)
        with pytest.raises(CommandError, match='no joint state from the controller'):
            await harness.commands.enable()
        open_gate(harness.driver.gate)
        goal = harness.submit(pose(0.1), start=HOME)
        assert 'no joint state' in (await goal.end()).text
        assert controller.received == []


@pytest.mark.parametrize(
    ('status', 'words'),
    [
        ((1, 1, 0, 0, 0, 2, 0), 'E-stop'),
        ((1, 0, 4031, 1, 0, 2, 0), 'in error 4031'),
        ((0, 0, 0, 0, 0, 2, 0), 'motors are off'),
    ],
    ids=['E-stop', 'error', 'motors off'],
)
async def test_271_a_status_alone_ends_the_goal_and_closes_the_gate(status, words):
    """No reply, no lost link: nothing but the STATUS says it."""
    async with (
        ScriptedController(lambda _: b'') as controller,
        Harness(controller.ports) as harness,
    ):
        await harness.ready()
        await harness.commands.enable()
        goal = harness.submit(pose(0.1))
        await until(lambda: controller.received)
        controller.status = status
        assert words in (await goal.end()).text
        assert words in harness.gate
        controller.status = ScriptedController.STATUS
        seen = len(harness.events.statuses)
        await until(lambda: len(harness.events.statuses) > seen + 2)
        assert words in harness.submit(pose(0.1)).outcome.text


def test_fanuc_9_a_plan_without_velocities_moves_as_fast_as_planned():
    limit = LIMITS.velocity[0]
    plan = Trajectory(
        LIMITS.names, np.array([0.0, 1.0, 2.0]), np.array([pose(0), pose(limit / 2), pose(limit)])
    )
    points = trajectory_points(plan, HOME, LIMITS, unmapped(len(LIMITS.names)))
    assert [point.velocity for point in points[1:]] == pytest.approx([0.5, 0.5])
    assert points[0].velocity == FIRST_POINT_VELOCITY_FRACTION
