# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver report FILE …`: reports on recorded runs, as HTML, JSON, or an MCAP bag."""

import argparse
from pathlib import Path

from epson_driver.cli.arguments import Parser, add_controller, add_robot, parsed
from epson_driver.cli.arguments import page as page_path
from epson_driver.error_texts import load_error_texts
from epson_driver.inputs import InputError, printable
from epson_driver.profiles import load_controller_profile
from epson_driver.report.figures import Figures, figures
from epson_driver.report.page import write_report
from epson_driver.report.run import Run, RunError
from epson_driver.report.trace_run import read_trace
from epson_driver.robots import RobotModel, load_robot_model

INSTALL = "pip install 'epson_driver[report]'"


def main() -> int:
    parser = _parser()
    arguments = parsed(parser)
    if arguments.compare and len(arguments.files) != 2:
        parser.error(f'--compare needs two files, not {len(arguments.files)}')
    single = len(arguments.files) == 1 or arguments.compare
    if not single and (arguments.output or arguments.mcap):
        parser.error('--output and --mcap need a single FILE (--output: or two with --compare)')
    if arguments.compare and arguments.mcap:
        parser.error('--mcap writes one run: omit --compare')
    try:
        model = load_robot_model(arguments.robot)
        runs = [_read(file, model, arguments) for file in arguments.files]
        if arguments.mcap is not None:
            from epson_driver.report.bag_file import write_bag  # needs the extra `report`

            write_bag(*runs[0], arguments.mcap)
            print(f'bag: {arguments.mcap}')
        groups = [runs] if arguments.compare else [[run] for run in runs]
        for group in groups:
            write_report(group, model, arguments.output or default_output(group))
    except (OSError, InputError, RunError) as error:
        parser.error(printable(error))
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition('.')[0] != 'rosbags':
            raise
        parser.error(f'bags need the library rosbags: {INSTALL}')
    return 0


def default_output(group: list[tuple[Run, Figures]]) -> Path:
    return Path('-'.join(Path(run.source).stem for run, _ in group) + '-report.html')


def _read(file: Path, model: RobotModel, arguments: argparse.Namespace) -> tuple[Run, Figures]:
    texts = load_error_texts(load_controller_profile(arguments.controller).error_texts)
    if is_bag(file):
        from epson_driver.report.bag_run import read_bag  # needs the extra `report`

        run = read_bag(file, texts, arguments.namespace)
    else:
        run = read_trace(file, model.limits, texts, arguments.address)
    if len(run.joint_names) != len(model.joint_names):
        raise RunError(
            f'{file}: {len(run.joint_names)} joints, but the robot {model.name} has '
            f'{len(model.joint_names)}: select its model with --robot'
        )
    return run, figures(run, model.limits.rad_per_unit)


def is_bag(path: Path) -> bool:
    return path.is_dir() or path.suffix in ('.mcap', '.db3')


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        'report',
        "Report on a run as one HTML page, from the driver's traces (trace_file), tcpdump "
        "captures, or bags (pip install 'epson_driver[report]').",
        ('report run.pcap', 'report --compare before.pcap after.pcap --output compared.html'),
        '0 done, 2 invalid arguments, 130 Ctrl-C',
    )
    parser.add_argument(
        'files',
        type=Path,
        nargs='+',
        metavar='FILE',
        help='trace (.pcap), or bag: its folder, .mcap or .db3 file',
    )
    parser.option(
        '--output FILE',
        'page for a single FILE or for --compare, with a JSON file next to it '
        '(default: FILE-report.html in the current folder)',
        page_path,
    )
    parser.option('--compare', 'one page with two runs side by side')
    parser.option(
        '--mcap FOLDER',
        'new folder for the run in a single FILE as an MCAP bag (default: none)',
        Path,
    )
    add_robot(parser)
    add_controller(parser, 'controller profile with the error texts')
    parser.option('--address ADDRESS', 'address of the controller, needed if a trace has several')
    parser.option('--namespace NAME', 'namespace of the robot, needed if a bag has several')
    return parser
