# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The robot models by name, and the entries of files that define each model.

config/robots/ has one file for each series. The file contains the data common to all models of the
series and, under `models`, a row of differences for each model. A row or a user's file with the
key `like` contains the differences from another model.
"""

import re
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from epson_driver.inputs import InputError, printable, read_yaml, shown, yaml_line
from epson_driver.share import share_path

MAX_NAMES = 6
"""Maximum number of similar names in the error for an unknown name."""

ALIKE = 0.4
"""Minimum similarity of a suggested name to the unknown name, 0 … 1, as defined by difflib."""


SOLD_AS = {
    'c4': ['c4_a601s'],
    'c4l': ['c4_a901s'],
    'c8xl': ['c8_a1401s', 'c8_c1401s'],
    'c8l': ['c8_a901s', 'c8_c901s'],
    'c12xl': ['c12_a1401s', 'c12_c1401s'],
    'ls3': ['ls3_401s'],
    's5': ['s5_a701s'],
    's5l': ['s5_a901s'],
    't3': ['t3_401s'],
    't6': ['t6_602s'],
    'vt6l': ['vt6_a901s'],
}
"""Sales name of an arm → its models. A sales name omits the generation and the mounting."""


class Layer(NamedTuple):
    """Values for a model: the file `path`, or the part of it under the nested keys `where`."""

    path: Path
    where: tuple[str, ...]
    values: dict[str, Any]


def robot_models() -> tuple[str, ...]:
    return tuple(_models())


def model_name(name: str) -> str:
    """Return the name of a model in config/robots/, or the path of a .yaml file unchanged.

    EPSON's spelling C4-A601S is also accepted, even without the hyphen or the last S. The
    unambiguous start of a name, and an arm's sales name, are accepted, too. Raises InputError for
    any other name, with similar names or with the unpublished data of an EPSON arm.
    """
    if name.endswith('.yaml'):
        return name
    if name in _models():
        return name
    models = {_plain(item): item for item in _models()}
    plain = _plain(name)
    start = SOLD_AS.get(plain) or [
        element for key, element in models.items() if plain and key.startswith(plain)
    ]
    if plain in models or plain + 's' in models:
        return models.get(plain) or models[plain + 's']
    if len(start) == 1:
        return start[0]
    alike = [models[match] for match in get_close_matches(plain, models, MAX_NAMES, ALIKE)]
    series = [model for model in models.values() if plain.startswith(model.partition('_')[0])]
    raise InputError(
        f'no robot model {printable(name)}{_unknown(plain) or _near(start or alike or series)} '
        f'(`epson_driver robots` lists all {len(models)})'
    )


def layers(name: str) -> list[Layer]:
    """Return the layers of the data of model `name`. Each layer overrides the previous ones."""
    name = model_name(name)
    if name.endswith('.yaml'):
        path = Path(name)
        own = Layer(path, (), _mapping(path, 'the file', read_yaml(path)))
        like = own.values.get('like')
        if like is None:
            return [own]
        why = 'must be the name of a model'
        if isinstance(like, str) and not like.endswith('.yaml'):
            try:
                return [*layers(like), own]
            except InputError as error:
                why = str(error)
        line = yaml_line(path, ('like',))
        raise InputError(f'{printable(path)}, line {line}: like = {shown(like)}: {why}')
    series, row = _models()[name]
    likes = [_models()[_listed(row.values['like'])][1]] if 'like' in row.values else []
    return [series, *likes, row]


@cache
def _models() -> dict[str, tuple[Layer, Layer]]:
    """Return two layers for each model: the data of its series, and the data of the model itself.

    The names are sorted.
    """
    result: dict[str, tuple[Layer, Layer]] = {}
    for path in share_path('config', 'robots').glob('*.yaml'):
        series = dict(_mapping(path, 'the file', read_yaml(path)))
        rows = _mapping(path, 'models', series.pop('models', None))
        common = Layer(path, (), series)
        for name, row in rows.items():
            own = Layer(path, ('models', name), _mapping(path, f'models.{name}', row))
            result[_listed(name)] = common, own
    return dict(sorted(result.items()))


def _mapping(path: Path, key: str, values: Any) -> dict[str, Any]:
    if not isinstance(values, dict):
        raise InputError(f'{printable(path)}: {key} = {shown(values)}: must be a mapping')
    return values


def _listed(name: str) -> str:
    return name.lower().replace('-', '_')


def _plain(name: str) -> str:
    return re.sub('[-_ ]', '', name.lower())


def _near(models: list[str]) -> str:
    names = models[:MAX_NAMES] + ['…'] * (len(models) > MAX_NAMES)
    return f'; did you mean {" or ".join(names)}?' if models else ''


def _unknown(plain: str) -> str:
    """Return a clause if `plain` is an EPSON arm whose data is unpublished, else ''."""
    unknown = read_yaml(share_path('config', 'unknown_robots.yaml'))
    series = [name for name in unknown if plain.startswith(_plain(name))]
    if not series:
        return ''
    name = max(series, key=len)
    return (
        f': of the {name}, {unknown[name]} not known. With its manual, adding a file takes ten '
        'minutes (docs/new_robot.md)'
    )
