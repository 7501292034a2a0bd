# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The Python API with a simulated controller, and programs that use it, as processes."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

from epson_driver import aio
from support.driver_harness import simulated
from support.interrupts import obey_interrupts

NO_ROS = Path(__file__).parent / 'no_ros'
"""Has a sitecustomize.py, which Python runs at its start: no ROS package can be imported then."""

PATIENCE = 'from support.api_patience import be_patient; be_patient(setattr)\n'
"""How each program begins: on a busy machine it is as right as elsewhere."""

FAR = [1.5, 0.2, -0.2, 0.0, 0.5, 0.0]


def ports_of(ports):
    """Return a simulated controller's ports as arguments of a Robot."""
    return {f'{name}_port': getattr(ports, name) for name in ('motion', 'state', 'io', 'remote')}


@contextlib.asynccontextmanager
async def robot_cell(
    *, enabled=True, profile='simulated', model='c3_a601s', settings=None, smooth=False
):
    """Run a simulated controller in this process; yield a connected robot, and the controller."""
    async with (
        simulated(profile=profile, model=model, smooth=smooth) as (controller, ports),
        aio.Robot(controller=profile, model=model, settings=settings, **ports_of(ports)) as robot,
    ):
        if enabled:
            await robot.enable()
        yield robot, controller


def program(code, *arguments, **options):
    """Start a Python program without ROS, its output as text."""
    path = os.pathsep.join([str(NO_ROS), *filter(None, sys.path)])
    return subprocess.Popen(
        [sys.executable, '-c', PATIENCE + code, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {'PYTHONPATH': path, 'PYTHONUNBUFFERED': '1'},
        preexec_fn=obey_interrupts,
        **options,
    )


def output(process):
    """Return what a program printed. It must end with 0."""
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    return out
