# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver robots [MODEL]`: lists the robot models, or shows all data of one model."""

import argparse
import os
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from epson_driver.cli.arguments import Parser, parsed
from epson_driver.inputs import InputError, number
from epson_driver.motion import Array
from epson_driver.robots import RobotModel, load_robot_model, robot_models
from epson_driver.robots.chain import SHOWN_UNITS
from epson_driver.robots.model import SCARA
from epson_driver.robots.opw import KinematicsError, opw_parameters
from epson_driver.robots.reader import MARKS
from epson_driver.robots.scara import scara_parameters

COLOURS = dict(zip(MARKS, ('green', 'yellow', 'yellow', 'red'), strict=True))


@dataclass(frozen=True)
class Sheet:
    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def main() -> int:
    parser = _parser()
    arguments = parsed(parser, positional='robot_model')
    if arguments.moveit and not arguments.model:
        parser.error('--moveit: MODEL is missing')
    try:
        if arguments.moveit:
            return _write(arguments)
        if arguments.model:
            sheets = _sheets(load_robot_model(arguments.model))
        else:
            sheets = [_overview(arguments)]
    except (OSError, InputError) as error:
        parser.error(str(error))
    console = Console(highlight=False)
    plain = arguments.plain or not console.is_terminal
    try:
        _print(sheets, console, plain)
    except BrokenPipeError:  # `| head` has closed the pipe, into which Python flushes at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _write(arguments: argparse.Namespace) -> int:
    # here, because it imports half of this package
    from epson_driver.bringup import BringupError, write_moveit_package

    try:
        paths = write_moveit_package(arguments.model, arguments.moveit)
    except BringupError as error:
        raise InputError(str(error)) from error
    print(*paths, sep='\n')
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        'robots',
        'List the robot models, or all numbers of one model with their sources.',
        ('robots --search scara --payload 6', 'robots c4_a601s'),
        '0 done, 2 invalid arguments',
        "\nconfirmed: by two independent sources, or by EPSON's for this model\n"
        'derived: computed from confirmed numbers, or from a sister model\n'
        'estimated: a proxy, from memory, or a guess\n'
        'Check all numbers that are not confirmed against the manipulator manual.',
    )
    parser.add_argument(
        'model',
        nargs='?',
        metavar='MODEL',
        help='robot model, such as c4_a601s or C4-A601S, or a .yaml file (default: all models)',
    )
    parser.option(
        '--search WORD',
        'only models with this word in the name or description (default: all)',
        default='',
    )
    size = number(0.0, 1e5)
    parser.option(
        '--payload KG', 'only models with at least this payload, kg (default: all)', size, 0.0
    )
    parser.option(
        '--reach MM', 'only models with at least this reach, mm (default: all)', size, 0.0
    )
    parser.option('--plain', 'tabs instead of tables, which is always so in a pipe')
    parser.option(
        '--moveit FOLDER',
        'folder for a new MoveIt package for MODEL, which '
        "MoveItConfigsBuilder('c4_a601s') finds if FOLDER is named c4_a601s_moveit_config",
        Path,
    )
    return parser


def _print(sheets: Iterable[Sheet], console: Console, plain: bool) -> None:
    for index, sheet in enumerate(sheets):
        if plain:
            lines = [sheet.head, *sheet.rows]
            title = [f'# {sheet.title}'] if sheet.title else []
            blank = [''] if index else []
            print(*blank, *title, *('\t'.join(line) for line in lines), sep='\n', flush=True)
            continue
        table = Table()
        for name in sheet.head:
            table.add_column(Text(name), overflow='fold')
        for row in sheet.rows:
            table.add_row(*(Text(word, style=COLOURS.get(word, '')) for word in row))
        console.print(*[Text(sheet.title, style='bold')] * bool(sheet.title), table, sep='\n')


def _overview(arguments: argparse.Namespace) -> Sheet:
    word = arguments.search.lower().replace('_', '-')
    models = [
        model
        for model in map(load_robot_model, robot_models())
        if word in model.description.lower()
        and (model.payload or 0.0) >= arguments.payload
        and model.reach[0] * 1e3 >= arguments.reach - 0.5
    ]
    head = ('name', 'kind', 'axes', 'reach [mm]', 'payload [kg]', *MARKS)
    return Sheet('', head, tuple(_line(model) for model in models))


def _line(model: RobotModel) -> tuple[str, ...]:
    by_mark = {
        mark: [name for name, origin in model.provenance.items() if origin.worst == mark]
        for mark in MARKS
    }
    return (
        model.name,
        model.kind,
        str(len(model.joint_names)),
        f'{model.reach[0] * 1e3:.0f}',
        '' if model.payload is None else f'{model.payload:g}',
        *(', '.join(names) for names in by_mark.values()),
    )


def _sheets(model: RobotModel) -> list[Sheet]:
    return [
        Sheet(
            f'{model.name}: {model.description}',
            ('what', 'value'),
            (
                ('kind', model.kind),
                ('payload', _kilograms(model.payload)),
                ('mass', _kilograms(model.mass)),
            ),
        ),
        Sheet(
            'Joints',
            ('quantity', *model.joint_names),
            tuple((name, *_words(values)) for name, values in _quantities(model)),
        ),
        Sheet('Chain, in base_link, m', ('frame', 'origin', 'axis or rpy'), tuple(_frames(model))),
        Sheet(
            f'{SCARA if model.kind == SCARA else "OPW"} lengths, m',
            ('length', 'value'),
            tuple(_lengths(model)),
        ),
        Sheet(
            'Sources',
            ('quantity', 'mark', 'source'),
            tuple(
                (name, ', '.join(dict.fromkeys(origin.marks)), origin.source)
                for name, origin in model.provenance.items()
            ),
        ),
    ]


def _quantities(model: RobotModel) -> Iterator[tuple[str, Array]]:
    """Yield the name and the values of each quantity in the table of a model.

    Limits are given in degrees or mm and in SI units.
    """
    limits = model.limits
    units = list(dict.fromkeys(limits.units))
    shown, si = ' or '.join(SHOWN_UNITS[unit][0] for unit in units), ' or '.join(units)
    for name, values, per in (
        ('position min', limits.position_min, ''),
        ('position max', limits.position_max, ''),
        ('velocity', limits.velocity, '/s'),
        ('acceleration', limits.acceleration, '/s²'),
        ('jerk', limits.jerk, '/s³'),
    ):
        yield f'{name} [{_per(shown, per)}]', values * model.shown_per_unit
        yield f'{name} [{_per(si, per)}]', values
    yield f'pulses per {shown.replace("degrees", "degree")}', model.pulses_per_degree
    yield f'reach [{"m" if units == ["rad"] else "m or 1"}]', model.reach


def _kilograms(value: float | None) -> str:
    return 'not known' if value is None else f'{value:g} kg'


def _per(units: str, per: str) -> str:
    return ' or '.join(unit + per for unit in units.split(' or '))


def _words(values: Array) -> list[str]:
    known = np.where(np.abs(values) < 1e-12, 0.0, values)
    return ['not known' if np.isnan(value) else f'{value:.7g}' for value in known]


def _frames(model: RobotModel) -> Iterator[tuple[str, ...]]:
    chain = model.chain
    rows = zip(model.joint_names, model.joint_types, chain.origins, chain.axes, strict=True)
    for name, kind, origin, axis in rows:
        yield f'{name}, {kind}', ' '.join(_words(origin)), ' '.join(_words(axis))
    for name, frame in (('tool0, in the last link', model.tool0), ('base', model.base)):
        yield name, ' '.join(_words(frame.xyz)), ' '.join(_words(frame.rpy))


def _lengths(model: RobotModel) -> Iterator[tuple[str, ...]]:
    parameters = scara_parameters if model.kind == SCARA else opw_parameters
    try:
        lengths = parameters(model).lengths
    except KinematicsError as error:
        yield 'none', str(error)
        return
    for name, value in lengths.items():
        yield name, *_words(np.array([value]))
