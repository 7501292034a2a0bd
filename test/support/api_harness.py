# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The Python API with a simulated controller, and programs that use the API as processes."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

from epson_driver import aio
from support.driver_harness import simulated
from support.interrupts import obey_interrupts

NO_ROS = Path(__file__).parent / 'no_ros'
"""Folder whose sitecustomize.py blocks the import of ROS packages at Python's start."""

PATIENCE = 'from support.api_patience import be_patient; be_patient(setattr)\n'
"""First line of each program: long time-outs for a busy machine."""

FAR = [1.5, 0.2, -0.2, 0.0, 0.5, 0.0]


def ports_of(ports):
    """Return a simulated controller's ports as arguments of a Robot."""
    return {f'{name}_port': getattr(ports, name) for name in ('motion', 'state', 'io', 'remote')}


@contextlib.asynccontextmanager
async def robot_cell(
    *, enabled=True, profile='simulated', model='c3_a601s', settings=None, smooth=False
):
    """Run a simulated controller in this process, and yield a connected robot and it."""
    async with (
        simulated(profile=profile, model=model, smooth=smooth) as (controller, ports),
        aio.Robot(controller=profile, model=model, settings=settings, **ports_of(ports)) as robot,
    ):
        if enabled:
            await robot.enable()
        yield robot, controller


def program(code, *arguments, **options):
    """Start a Python program without ROS, with text output."""
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
    """Return a program's output, and assert that it exits with 0."""
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    return out
