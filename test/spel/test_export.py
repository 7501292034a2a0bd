# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`spel export`: a complete project for every robot and controller, in the format of RC+."""

from argparse import Namespace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from support.examples import one_in

from epson_driver.cli.spel_commands import export
from epson_driver.inputs import InputError
from epson_driver.inputs.rc_files import header_fault, parsed
from epson_driver.robots import load_robot_model, robot_models
from epson_driver.share import share_path
from epson_driver.sim_controller.assembly import robot_defines
from epson_driver.spel import read_project, with_defines
from epson_driver.spel.commands import CONTROLLERS
from epson_driver.spel.export import exported
from epson_driver.spel.lint import check

FILES = read_project(share_path('controller_program'))
WHEN = datetime(2026, 1, 1, tzinfo=UTC)


def of(robot: str) -> dict[str, str]:
    return with_defines(FILES, robot_defines(FILES, load_robot_model(robot)))


@cache
def problems(config: str) -> list[Any]:
    """Return the problems of the program with a configuration. Robots share configurations."""
    return check(FILES | {'config.inc': config})


@pytest.mark.parametrize('robot', one_in(125, robot_models()))
def test_program_of_every_robot_has_no_problems(robot: str) -> None:
    files = of(robot)
    assert files.keys() == FILES.keys()
    assert all(text == FILES[name] for name, text in files.items() if name != 'config.inc')
    assert problems(files['config.inc']) == []
    name = robot.upper().replace('_', '-')
    assert f'#define ROBOT_MODEL "{name}"\n' in files['config.inc']


@pytest.mark.parametrize('version', one_in(3, sorted(set(CONTROLLERS.values()), reverse=True)))
@pytest.mark.parametrize('robot', ['c3_a601s', pytest.param('gx4_c251s', marks=pytest.mark.slow)])
def test_program_has_no_problems_on_every_controller(robot: str, version: int) -> None:
    assert check(of(robot), version) == []


@pytest.mark.parametrize('version', one_in(3, [7, 6, 8]))
def test_exported_project_can_be_read(tmp_path: Path, version: int) -> None:
    files = of('gx4_c251s')
    written = exported('cell', files, version, WHEN)
    for name, content in written.items():
        (tmp_path / name).write_bytes(content)
        assert b'\n' not in content.replace(b'\r\n', b'')
        if not name.endswith(('.prg', '.inc')):
            assert header_fault(content) == '', name
    project = parsed('cell.sprj', written['cell.sprj'].decode())
    listed = [block.text('sName') for block in project.blocks('ProgramFile')]
    listed += [block.text('sName') for block in project.blocks('IncludeFile')]
    assert sorted(listed) == sorted(file for file in files if file.endswith(('.prg', '.inc')))
    named = [*listed, 'robot1.pts', 'IOLabels.dat', 'UserErrors.dat', 'cell.vis', 'cell.sprj']
    assert sorted(named) == sorted(written)
    again = read_project(tmp_path)
    shared = files.keys() - ({'UserErrors.dat'} if version == 6 else set())
    assert all(again[name] == files[name] for name in shared)
    assert check(again, version) == []


def test_rc620_export_has_the_blocks_of_rc_6_0_0() -> None:
    """Blocks and keys are those in EPSON's sample ConveyorDemo1, written by RC+ 6.0.0."""
    written = exported('cell', FILES, 6, WHEN)
    texts = {name: content.decode() for name, content in written.items()}
    for name in ('cell.sprj', 'UserErrors.dat', 'IOLabels.dat'):
        assert texts[name].count('sRCVersion') == texts[name].count('sRCVersion="6.0.0"') == 1
    for key in ('sRCRevision', 'bGlobalsDeclaredEachFile', 'bSimulatorButton', 'bAllowReset'):
        assert key not in texts['cell.sprj']
        assert key in exported('cell', FILES, 7, WHEN)['cell.sprj'].decode()
    assert 'Program63 {' in texts['cell.sprj']


def test_error_labels_of_the_program_match_their_file() -> None:
    errors = parsed('UserErrors.dat', FILES['UserErrors.dat'])
    assert [block.text('sLabel') for block in errors.blocks('Label')] == [
        'CORRUPT_MSG', 'NOT_READY', 'STOPPED_BY_BIT', 'CLIENT_SILENT'
    ]  # fmt: skip
    assert header_fault((share_path('controller_program') / 'UserErrors.dat').read_bytes()) == ''


def test_export_is_reproducible() -> None:
    assert exported('a', FILES, 7, WHEN) == exported('a', FILES, 7, WHEN)


def export_into(folder: Path, robot: str = 'c3_a601s', controller: str = 'rc620') -> int:
    return export(Namespace(folder=folder, robot=robot, controller=controller, address='10.0.0.2'))


def test_export_needs_a_new_folder(tmp_path: Path) -> None:
    assert export_into(tmp_path / 'Cell_1') == 0
    config = (tmp_path / 'Cell_1' / 'config.inc').read_text()
    assert '#define OWN_ADDRESS "10.0.0.2"\n' in config
    assert '#define IO_FIRST_OUTPUT_BYTE 0\n' in config  # p953: RC+ 6 assigns none
    with pytest.raises(InputError, match='must be a new or empty folder'):
        export_into(tmp_path / 'Cell_1')


@pytest.mark.parametrize(
    ('robot', 'controller', 'text'),
    [
        ('t6_602s', 'rc90', 'must be t, built into its base'),
        ('vt6_a901s', 't', 'must be vt, built into its base'),
        ('c4_a601s', 'vt', 'must be another one'),
    ],
)
def test_controller_that_the_model_never_had_is_refused(
    tmp_path: Path, robot: str, controller: str, text: str
) -> None:
    with pytest.raises(InputError, match=f'^--controller {controller}: .*{robot} {text}'):
        export_into(tmp_path / 'Cell', robot, controller)
    assert export_into(tmp_path / 'Own', 't6_602s', 't') == 0


@pytest.mark.parametrize('name', ['Zelle_ö', 'my "cell"', 'x' * 25])
def test_invalid_project_name_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match='must be 1 to 24 letters'):
        export_into(tmp_path / name)
    assert list(tmp_path.iterdir()) == []
