# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Takes the pictures of panel, report, exercise and doctor in docs/images, in chromium.

python -m generate.screenshots [panel] [report] [exercise] [doctor]

Needs Debian's chromium and `make browser`. Each takes a minute or two.
"""

import io
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image
from rich.console import Console
from rich.text import Text

from epson_driver import Robot, Settings
from epson_driver.motion import Trajectory
from epson_driver.processes import processes
from epson_driver.share import share_path
from epson_driver.trajectory_file import read_trajectory, write_trajectory

ROOT = Path(__file__).parents[1]
IMAGES = ROOT / 'docs' / 'images'
COMMAND = [sys.executable, '-m', 'epson_driver.cli']
TIMEOUT_MS = 120_000

PANEL_SIZE = 1500, 900
REPORT_SIZE = 1500, 1130
TERMINAL_COLUMNS = 112

SLOWER = 6.0
"""Factor of the motion's duration for the panel's picture, which takes seconds without a graphics
card."""

TAKEN_S = 8.0
"""Time of the picture after the start of the motion, s."""


@contextmanager
def tab(width: int, height: int) -> Iterator[Any]:
    """Yield a tab of a browser."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which('chromium') or shutil.which('google-chrome')
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium, args=['--no-sandbox'], timeout=TIMEOUT_MS
        )
        try:
            page = browser.new_page(viewport={'width': width, 'height': height})
            page.set_default_timeout(TIMEOUT_MS)
            yield page
        finally:
            browser.close()


def save(page: Any, name: str) -> None:
    """Save a screenshot of the tab to docs/images."""
    picture = Image.open(io.BytesIO(page.screenshot(timeout=TIMEOUT_MS))).convert('RGB')
    path = IMAGES / name
    if path.suffix == '.webp':
        picture.save(path, quality=90, method=6)
    else:
        picture.quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
    print(path.relative_to(ROOT))


def panel() -> None:
    """Take the panel at rest, while the arm follows a plan, in E-stop, and with two robots."""
    plan = read_trajectory(share_path('config', 'trajectories', 'around_pillar_11_points.yaml'))
    slow = Trajectory(plan.joint_names, plan.times * SLOWER, plan.positions)
    with tempfile.TemporaryDirectory(prefix='epson_driver_pictures_') as name:
        folder = Path(name)
        file = folder / 'around_pillar.yaml'
        write_trajectory(file, slow, 'around a pillar, slowly')
        controller = processes.sim_controller(
            folder / 'sim_controller.log', start=plan.positions[0].tolist()
        )
        with processes.ended_at_exit(controller):
            ports = controller.ports()
            domain = processes.free_ros_domain()
            client = processes.client(folder / 'client.log', ports, domain)
            environment = processes.ros_environment(domain)
            served = processes.Process(
                'panel', ['--port=0', f'--trajectory={file}'], folder / 'panel.log', environment
            )
            with processes.ended_at_exit(served, client), tab(*PANEL_SIZE) as page:
                page.goto(served.address())
                _panel(page, ports.remote)
    _two_robots()


def _two_robots() -> None:
    with tempfile.TemporaryDirectory(prefix='epson_driver_pictures_') as name:
        folder = Path(name)
        names = ('left', 'right')
        controllers = [processes.sim_controller(folder / f'{item}.log') for item in names]
        with processes.ended_at_exit(*controllers):
            ports = dict(
                zip(names, (controller.ports() for controller in controllers), strict=True)
            )
            domain = processes.free_ros_domain()
            client = processes.clients(folder / 'client.log', ports, domain)
            environment = processes.ros_environment(domain)
            served = processes.Process('panel', ['--port=0'], folder / 'panel.log', environment)
            with processes.ended_at_exit(served, client), tab(*PANEL_SIZE) as page:
                page.goto(served.address())
                press = [*COMMAND, 'pendant', f'--port={ports["right"].remote}', 'door', 'open']
                subprocess.run(press, check=True, capture_output=True)
                page.locator('#robots button', has_text='left').click()
                page.wait_for_selector('#robots [data-sign="✕"]')
                page.wait_for_timeout(5_000)
                save(page, 'panel_two_robots.webp')


def _panel(page: Any, remote_port: int) -> None:
    def button(label: str) -> Any:
        return page.get_by_role('button', name=label, exact=True)

    for lamp in ('Link', 'Door'):
        page.wait_for_selector(f'[data-lamp="{lamp}"][data-colour="good"]')
    page.wait_for_timeout(5_000)  # for the curves
    save(page, 'panel_rest.webp')
    button('Arm').click()
    page.wait_for_selector('body.armed')
    button('Enable').click()
    page.wait_for_selector('[data-lamp="Enabled"][data-colour="good"]')
    button('Execute').click()
    page.wait_for_timeout(1e3 * TAKEN_S)
    save(page, 'panel_motion.webp')
    # fails if driver or page stalled on a busy machine: run the command again
    page.wait_for_selector('.armed [data-lamp="Motion"][data-colour="good"]', timeout=1e3)
    press = [*COMMAND, 'pendant', f'--port={remote_port}', 'estop', 'press']
    subprocess.run(press, check=True, capture_output=True)
    page.wait_for_selector('[data-lamp="E-stop"][data-colour="bad"]')
    page.wait_for_timeout(3_000)
    save(page, 'panel_estop.webp')


def report() -> None:
    """Take a report that compares two runs of the demo, and a report with an E-stop."""
    with tempfile.TemporaryDirectory(prefix='epson_driver_pictures_') as name:
        picture, trace = Path(name, 'demo.png'), Path(name, 'night.pcap')
        demo = [*COMMAND, 'demo', '--compare', f'--picture={picture}']
        subprocess.run(demo, check=True)
        _report(picture.with_suffix('.html'), 'report.png', '() => 1.51')
        _repeated_after_an_estop(trace)
        page = trace.with_suffix('.html')
        subprocess.run([*COMMAND, 'report', str(trace), f'--output={page}'], check=True)
        _report(page, 'report_estop.png', AFTER_THE_ESTOP)


AFTER_THE_ESTOP = """() => {
    const rows = [...document.querySelectorAll('#events tr')];
    return parseFloat(rows.find((row) => row.innerText.includes('E-stop')).innerText) + 1.0;
}"""


def _report(path: Path, name: str, moment: str) -> None:
    """Take a report at the time, s, that a function in the page returns."""
    with tab(*REPORT_SIZE) as page:
        page.goto(f'file://{path}')
        page.wait_for_selector('body[data-ready=yes]')
        page.evaluate(f"""() => {{
            const slider = document.getElementById('time');
            slider.value = ({moment})();
            slider.dispatchEvent(new Event('input', {{bubbles: true}}));
        }}""")
        page.wait_for_timeout(3_000)
        save(page, name)


def _repeated_after_an_estop(trace: Path) -> None:
    """Record a motion that an E-stop interrupts, and its repetition."""
    target = [0.8, 0.5, 0.1, 0.3, -0.4, 0.0]
    with Robot.simulated(enable=True, settings=Settings(trace_file=str(trace))) as robot:
        robot.move_joints(target, speed=0.05, wait=False)
        time.sleep(1.5)
        robot.simulation.estop()
        time.sleep(3.0)
        robot.simulation.estop(pressed=False)
        robot.reset()
        robot.enable()
        robot.move_joints(target, speed=0.1)


EXERCISED = ('estop', 'door', 'pause', 'cut', 'lost_reply', 'frozen_encoder', 'reboot')
"""Faults in the picture of an exercise. All 20 take minutes: each starts its own processes."""


def exercise() -> None:
    """Take the exercise's output for a correct program."""
    programs = ROOT / 'test' / 'exercise' / 'programs'
    faults = [f'--fault={name}' for name in EXERCISED]
    _terminal(['exercise', *faults, '--', 'python3', 'good.py'], 0, 'reason', cwd=programs)


def doctor() -> None:
    """Take the doctor's output for a controller in E-stop."""
    with tempfile.TemporaryDirectory(prefix='epson_driver_pictures_') as name:
        profile = ['--controller=spel']
        log, environment = Path(name, 'log'), dict(os.environ)
        controller = processes.Process('sim_controller', profile, log, environment)
        with processes.ended_at_exit(controller):
            controller.ports()
            press = [*COMMAND, 'pendant', 'estop', 'press']
            subprocess.run(press, check=True, capture_output=True)
            _terminal(['doctor', '127.0.0.1', '--controller', 'spel', '--ask'], 1)


def _terminal(words: list[str], code: int, begin: str = '', cwd: Path = ROOT) -> None:
    """Take a command's output as an image of a terminal, from the line with `begin`.

    Raises RuntimeError for another exit code, for example on a busy machine.
    """
    environment = os.environ | {
        'COLUMNS': str(TERMINAL_COLUMNS),
        'FORCE_COLOR': '1',
        'TTY_INTERACTIVE': '0',  # no progress, which a terminal would overwrite
        'ROS_DOMAIN_ID': '42',
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'TERM': 'xterm-256color',
        'PATH': f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}',
    }
    ended = subprocess.run(
        [*COMMAND, *words],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if ended.returncode != code:
        raise RuntimeError(
            f'{words[0]}: exit code {ended.returncode}, not {code}:\n{ended.stdout}'
        )
    lines = ended.stdout.replace(str(ROOT), '~/epson_driver').splitlines()
    first = next(number for number, line in enumerate(lines) if begin in line)
    console = Console(record=True, width=TERMINAL_COLUMNS, file=io.StringIO())
    console.print(f'[bold]$ epson_driver {" ".join(words)}[/]', highlight=False)
    console.print(Text.from_ansi('\n'.join(lines[first:])))
    with tab(1300, 1000) as page:
        page.set_content(console.export_svg(title=f'epson_driver {words[0]}'))
        page.locator('body').evaluate('(e) => { e.style.margin = 0; }')
        drawn = page.locator('svg').bounding_box()
        height = round(1300 * drawn['height'] / drawn['width'])
        page.set_viewport_size({'width': 1300, 'height': height})
        save(page, f'{words[0]}.png')


PICTURES = {'panel': panel, 'report': report, 'exercise': exercise, 'doctor': doctor}


def main(names: list[str]) -> None:
    """Take the pictures of these names, or all."""
    for name in names or PICTURES:
        PICTURES[name]()


if __name__ == '__main__':
    main(sys.argv[1:])
