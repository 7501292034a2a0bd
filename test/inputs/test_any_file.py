# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""docs/invariants.md, 7, for files: any content is read or refused with one sentence.

Real files are changed: keys are removed or doubled, values replaced by any YAML value, and bytes
replaced. Every reader of YAML and the reader of recordings reads each of them.
"""

import copy
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.examples import examples
from support.longer_arm import arm_file

from epson_driver.error_texts import read_error_texts
from epson_driver.inputs import InputError
from epson_driver.motion import problems
from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.share import share_path
from epson_driver.trajectory_file import read_trajectory

pytestmark = pytest.mark.invariant(7)


def _trajectory(path: Path) -> None:
    for timed in (True, False):
        trajectory = read_trajectory(path, timed=timed)
        limits = load_robot_model('c3_a601s').limits
        if set(trajectory.joint_names) == set(limits.names):
            assert all(isinstance(text, str) for text in problems(trajectory, limits))


def _model(path: Path) -> None:
    model = load_robot_model(str(path))
    assert model.mark
    assert model.kind
    assert (model.reach >= 0.0).all()


READERS: dict[str, tuple[Callable[[Path], object], Path]] = {
    'robot': (_model, arm_file(Path(mkdtemp()), 6)),
    'controller': (
        lambda path: load_controller_profile(str(path)),
        share_path('config', 'controllers') / 'simulated.yaml',
    ),
    'errors': (read_error_texts, share_path('config', 'errors') / 'epson.yaml'),
    'trajectory': (
        _trajectory,
        share_path('config', 'trajectories') / 'around_pillar_11_points.yaml',
    ),
}

SCALARS = st.sampled_from(
    [
        '',
        '~',
        'true',
        '.nan',
        '-.inf',
        '-0.0',
        '5e-324',
        '1e300',
        '1e-300',
        '1e999',
        '9' * 400,
        '9' * 5000,
        '0x' + 'f' * 5000,
        '2026-99-99',
        '2026-01-01',
        '1:30',
        '010',
        '1_000',
        '"\\0"',
        '"\\ud800"',
        '"a\\nb"',
        '"' + 'x' * 20_000 + '"',
        'Gelenk ä',
        '=',
        '<<',
        '!!python/object/apply:os.system [true]',
        '!!timestamp 2026-99-99',
        '!!int x',
        '!!binary ====',
        '*nothing',
        '&a [*a]',
        '../../etc/passwd',
        '/dev/zero',
        '/tmp',
        'like.yaml',
        'nothing.yaml',
    ]
)
COLLECTIONS = st.sampled_from(
    ['[]', '{}', '[1]', '[[1]]', '{a: 1}', '[~, x]', '{sec: x}', '[' * 30 + ']' * 30, '[' * 5000]
)
VALUES = SCALARS | COLLECTIONS


def _places(data: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield place
    if isinstance(data, dict | list):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from _places(value, (*place, key))


@cache
def _original(path: Path) -> tuple[Any, list[tuple[Any, ...]]]:
    content = yaml.safe_load(path.read_text('utf-8'))
    return content, list(_places(content))


PLACEHOLDER = 'PLACEHOLDER'


def _changed(data: Any, place: tuple[Any, ...], value: str | None) -> str:
    """Return the file with the value at a place replaced, or removed if None."""
    whole = {'root': copy.deepcopy(data)}
    inner: Any = whole
    path = ('root', *place)
    for key in path[:-1]:
        inner = inner[key]
    if value is None:
        del inner[path[-1]]
    else:
        inner[path[-1]] = PLACEHOLDER
    if 'root' not in whole:
        return ''
    # a single flow collection keeps the file valid around the replaced value
    text = yaml.safe_dump(whole['root'], default_flow_style=True, width=10**6, sort_keys=False)
    return text.replace(PLACEHOLDER, value or '')


def read_or_refused(reader: Callable[[Path], object], path: Path) -> bool:
    """Return whether the file was read. Check the error otherwise."""
    try:
        reader(path)
    except InputError as error:
        text = str(error)
        assert str(path.parent) in text or text.startswith('no controller profile ')
    else:
        return True
    assert text.isprintable(), text
    assert len(text) < 1000, text
    return False


ANY_TIME = settings(
    max_examples=examples(150),
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@pytest.mark.parametrize('name', READERS)
def test_valid_file_is_read(name: str, tmp_path: Path) -> None:
    reader, original = READERS[name]
    path = tmp_path / 'file.yaml'
    path.write_text(_changed(yaml.safe_load(original.read_text('utf-8')), (), None))
    assert not read_or_refused(reader, path)
    path.write_bytes(original.read_bytes())
    assert read_or_refused(reader, path)


@pytest.mark.parametrize('name', READERS)
@ANY_TIME
@given(data=st.data())
def test_inv7_file_with_any_value_is_read_or_refused(name: str, tmp_path: Path, data: Any) -> None:
    reader, original = READERS[name]
    content, places = _original(original)
    place = data.draw(st.sampled_from(places))
    value = data.draw(st.none() | VALUES)
    path = tmp_path / 'file.yaml'
    path.write_text(_changed(content, place, value), encoding='utf-8')
    read_or_refused(reader, path)


@pytest.mark.parametrize('name', READERS)
@ANY_TIME
@given(data=st.data())
def test_inv7_file_with_any_bytes_is_read_or_refused(name: str, tmp_path: Path, data: Any) -> None:
    reader, original = READERS[name]
    content = original.read_bytes()
    start = data.draw(st.integers(0, len(content)))
    length = data.draw(st.integers(0, 40))
    content = content[:start] + data.draw(st.binary(max_size=20)) + content[start + length :]
    content = content[: data.draw(st.just(len(content)) | st.integers(0, len(content)))]
    path = tmp_path / 'file.yaml'
    path.write_bytes(content)
    read_or_refused(reader, path)


@pytest.mark.parametrize('name', READERS)
@ANY_TIME
@given(text=st.text(alphabet='[]{}:,-#&*!|>\'"%@` \n\tab1.?~', max_size=60))
def test_inv7_file_with_any_text_is_read_or_refused(name: str, tmp_path: Path, text: str) -> None:
    path = tmp_path / 'file.yaml'
    path.write_text(text, encoding='utf-8')
    assert not read_or_refused(READERS[name][0], path)
