# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver sim_controller`: a simulated EPSON controller as a plain process."""

import argparse
import asyncio
import contextlib
import dataclasses
import gc
import logging
import os
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from epson_driver.cli.arguments import (
    DEFAULT_MODEL,
    FREE_PORT,
    PORT,
    Parser,
    add_password,
    argument,
    host,
    if_in_use,
    parsed,
    with_start_joined,
)
from epson_driver.cli.spel_options import (
    DEFAULT_CONTROLLER,
    add_program_options,
    environment_of,
    program_of,
    settings_of,
)
from epson_driver.inputs import InputError, count, number, shown
from epson_driver.log_lines import StderrLog
from epson_driver.motion import Array, JointLimits
from epson_driver.processes.command import module_command
from epson_driver.processes.interrupt import ended_by_signals
from epson_driver.profiles.profile import (
    ControllerProfile,
    load_controller_profile,
)
from epson_driver.profiles.profile_rules import LOOK_AHEAD_S
from epson_driver.robots import RobotModel, load_robot_model
from epson_driver.rtmc.transport import TransportError
from epson_driver.setup.robot_file import password_in
from epson_driver.sim_controller.arm.planner_process import PlannerError, PlannerProcess
from epson_driver.sim_controller.assembly import (
    new_controller,
    profile_project,
    program_network,
    with_all_boards,
)
from epson_driver.sim_controller.condition.errors import angles_rejection, clipped
from epson_driver.sim_controller.faults.fault_kinds import Fault, parse
from epson_driver.sim_controller.network.servers import ControllerServers, Ports
from epson_driver.sim_controller.spel_host.spel_program import SpelSource
from epson_driver.simple_message import ByteOrder, Dialect
from epson_driver.spel import Program, Settings, read_project

_PORTS = Ports()

NOT_FOR_PROGRAMS = {
    'motion': 'its motion itself',
    'look_ahead': 'itself how many points it accepts ahead',
    'state_period': 'itself when it sends states',
    'byte_order': 'its byte order itself',
}
"""Options that do not apply to SPEL+ programs → what the program determines itself."""


def main() -> int:
    parser = _parser()
    args = parsed(parser, with_start_joined(sys.argv[1:]))
    folder = args.program
    if folder is not None and not folder.is_dir():
        folder = folder.parent
    try:
        settings = settings_of(args, folder)
        if args.profile_from is not None:
            from epson_driver.first_run.record import load, replica_settings  # loads the doctor

            first_run = replica_settings(load(args.profile_from))
            args.robot, args.motion = first_run.robot, args.motion or first_run.motion
            args.fault = [*first_run.faults, *args.fault]
            profile = first_run.profile
        else:
            profile = load_controller_profile(settings.controller or DEFAULT_CONTROLLER)
        if args.program is not None:
            profile = with_all_boards(profile)
        for name in ('remote', 'rtmc'):
            section = getattr(profile, name)
            password = password_in(args.password_variable, section.password)
            section = dataclasses.replace(section, password=password)
            profile = dataclasses.replace(profile, **{name: section})
        model = load_robot_model(args.robot or settings.robot or DEFAULT_MODEL)
        start = None if args.start is None else _start(args.start, model.limits)
        program = _program(args, profile, model, settings, folder)
    except (OSError, InputError) as error:
        parser.error(str(error))
    if program is not None:
        for option, why in NOT_FOR_PROGRAMS.items():
            if getattr(args, option) is not None:
                name = option.replace('_', '-')
                parser.error(f'--{name} cannot be set for a SPEL+ program, which determines {why}')
    byte_order = profile.byte_order
    if args.byte_order is not None:
        byte_order = ByteOrder[args.byte_order.upper()]
    if args.look_ahead is not None:
        motion = dataclasses.replace(profile.motion, look_ahead=args.look_ahead)
        profile = dataclasses.replace(profile, motion=motion)
    smooth = program is None and args.motion != 'ptp'
    planner = PlannerProcess(model.limits) if smooth else None
    spel = None
    if program is not None:
        around = environment_of(settings, folder)
        spel = SpelSource(program, program_network(profile), environment=around)
    try:
        controller = new_controller(
            model, profile, start, Dialect(byte_order), planner, args.state_period, args.seed, spel
        )
        for fault in args.fault:
            controller.faults.start(fault)
    except (ValueError, InputError) as error:  # joints, faults or the program are invalid
        parser.error(str(error))
    ports = Ports(*[_port_of(args, name, profile) for name in Ports._fields])
    log = StderrLog()
    logging.basicConfig(level=logging.INFO, handlers=[log])
    try:
        network = None if spel is None else spel.network
        rtmc_port = profile.rtmc.port or None
        if rtmc_port is not None and args.rtmc_port is not None:
            rtmc_port = args.rtmc_port
        servers = partial(
            ControllerServers, controller, planner, network, dict(args.program_port), rtmc_port
        )
        return asyncio.run(_run(servers, ports, args))
    finally:
        log.finish()


def _program(
    args: argparse.Namespace,
    profile: ControllerProfile,
    model: RobotModel,
    settings: Settings,
    folder: Path | None,
) -> Program | None:
    if args.program is not None:
        files = read_project(args.program)
    elif profile.spel.project:
        files = profile_project(profile, model)
    elif args.define or args.set:
        raise InputError(f'{"--define" if args.define else "--set"}: needs a SPEL+ program')
    else:
        return None
    return program_of(args, files, settings, folder or Path())


def _port_of(args: argparse.Namespace, name: str, profile: ControllerProfile) -> int:
    requested: int | None = getattr(args, f'{name}_port')
    if requested is not None:
        return requested
    return int(getattr(profile.ports, name) or getattr(_PORTS, name))


async def _run(
    new_servers: Callable[[], ControllerServers], ports: Ports, args: argparse.Namespace
) -> int:
    stop = asyncio.Event()
    with ended_by_signals(asyncio.get_running_loop(), stop.set):
        if args.until_stdin_ends:
            _watch_stdin(stop)
        servers = new_servers()
        try:
            ports = await servers.open(args.host, ports)
        except (OSError, PlannerError, TransportError) as error:
            advice = if_in_use(error.__cause__)
            print(f'epson_driver sim_controller: {error}{advice}', file=sys.stderr)
            return 1
        gc.collect()
        gc.freeze()  # spares the motion cycle a scan of the permanent objects
        print(
            'listening', *(f'{name}={port}' for name, port in ports._asdict().items()), flush=True
        )
        panel = None
        if args.panel:  # a separate process, because it needs ROS
            command = module_command('epson_driver.cli', 'panel')
            panel = await asyncio.create_subprocess_exec(*command)
        try:
            await servers.run_until(stop)
        finally:
            if panel is not None:
                with contextlib.suppress(ProcessLookupError):  # it has ended and printed why
                    panel.terminate()
                await panel.wait()
            await servers.close()
    return 0


def _watch_stdin(ended: asyncio.Event) -> None:
    """Set `ended` when stdin closes, for example because the parent process has ended."""
    loop, file = asyncio.get_running_loop(), sys.stdin.fileno()

    def read() -> None:
        if not os.read(file, 65536):
            loop.remove_reader(file)
            ended.set()

    loop.add_reader(file, read)


def _start(text: str, limits: JointLimits) -> Array:
    try:
        start = np.array([float(part) for part in text.split(',')])
    except ValueError as cause:
        rule = 'must be numbers separated by commas, rad or m'
        raise InputError(f'--start {shown(text)}: {rule}') from cause
    if start.shape != (len(limits.names),):
        raise InputError(
            f'--start {shown(text)}: {start.size} angles for {len(limits.names)} joints'
        )
    rejection = angles_rejection(start, limits)
    if rejection is not None:
        raise InputError(f'--start: {rejection.sentence}. Angles are in rad: 90° are 1.5708')
    return clipped(start, limits)


def _fault(text: str) -> Fault:
    try:
        return parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _program_port(text: str) -> tuple[int, int]:
    port, _, listening = text.partition('=')
    try:
        return argument(PORT)(port), argument(FREE_PORT)(listening)
    except argparse.ArgumentTypeError as error:
        raise argparse.ArgumentTypeError(f'{shown(text)}, PORT=PORT: {error}') from error


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        'sim_controller',
        'Simulate an EPSON controller until SIGINT or SIGTERM.',
        (
            'sim_controller --robot c4_a601s --panel',
            'sim_controller --controller spel --fault late_reply:seconds=3',
        ),
        '0 stopped by a signal, 1 a port is in use or the planner failed, 2 invalid arguments',
    )
    parser.option('--host ADDRESS', 'address to listen on', host, '127.0.0.1')
    for name, default in _PORTS._asdict().items():
        text = f"{name} port (0: any free port, default: the profile's, {default} for simulated)"
        parser.option(f'--{name}-port PORT', text, FREE_PORT)
    add_password(parser)
    parser.option(
        '--rtmc-port PORT',
        'UDP port of Real-time Motion Control, if the profile has it '
        "(0: the number of the motion port, default: the profile's)",
        FREE_PORT,
    )
    add_program_options(parser)
    parser.option(
        '--profile-from FILE',
        'page of a first-run: use its model, profile, motion and delays, instead of --robot '
        'and --controller',
        Path,
    )
    parser.add_argument(
        '--motion',
        choices=('smooth', 'ptp'),
        help='smooth: through all points without a stop; ptp: rest at every point '
        '(default: smooth, not with a SPEL+ program)',
    )
    parser.option(
        '--program FILE',
        'SPEL+ program to run: project folder, its .sprj or a .prg file '
        "(default: the profile's, or the built-in program)",
        Path,
    )
    parser.option(
        '--program-port PORT=PORT',
        'TCP port that the SPEL+ program opens = port to listen on (0: any free port, '
        'repeatable, default: the same port, or a free one if it is in use)',
        _program_port,
        [],
        action='append',
    )
    parser.option(
        '--look-ahead S',
        "look-ahead of smooth motion, s (default: the profile's)",
        number(*LOOK_AHEAD_S, 's'),
    )
    parser.add_argument(
        '--byte-order',
        choices=('little', 'big'),
        help="byte order of all messages (default: the profile's)",
    )
    parser.option(
        '--state-period S',
        "state message period, s (default: the profile's, 0.005 for simulated)",
        number(0.001, 3600.0, 's'),
    )
    parser.option(
        '--fault NAME[:KEY=VALUE,…]',
        'initial fault (repeatable, default: none, `pendant fault kinds` lists them)',
        _fault,
        [],
        action='append',
    )
    parser.option('--seed N', 'seed for random faults', count(0, 2**63 - 1), 0)
    parser.option(
        '--until-stdin-ends',
        'exit when standard input closes, for example when the parent process ends',
    )
    parser.option('--panel', 'start the panel of ROS too (without ROS: panel --simulated)')
    parser.option(
        '--start Q1,Q2,…',
        'initial joint positions, rad or m, such as -1.0,0.2,0,0,0,0 (default: all 0)',
    )
    return parser
