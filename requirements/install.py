# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Installs what make needs into .venv: one line per step, with sizes and a progress bar.

It runs before anything is installed, so it uses the standard library only. On a terminal pip's
output is replaced by a bar; all of it is kept in .venv/install.log, and shown with advice when a
step fails.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib.util
import json
import os
import platform
import re
import selectors
import shlex
import shutil
import subprocess
import sys
import sysconfig
import time
import venv
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
VENV = ROOT / '.venv'
CONSTRAINTS = 'requirements/constraints.txt'
HASHES = 'requirements/hashes.txt'
"""With it as a second file of constraints, pip installs no file that is not in it."""
INTERFACES = ('control_msgs', 'epson_msgs', 'industrial_msgs', 'tf2_msgs')
MEGABYTE = 1e6
DISK_MARGIN = 1.3
"""Free space needed over final disk use: pip unpacks wheels beside its downloads."""


class Step(NamedTuple):
    """Packages that are installed together."""

    name: str
    title: str
    files: tuple[str, ...]
    """Requirement files, from the project's folder."""
    download: int
    """What pip downloads, MB, as measured on Linux, x86-64 (test_install.py compares)."""
    disk: int
    """What it occupies in .venv, MB, measured the same way."""
    alone: str = ''
    """One of its packages; if that is already installed, so is much of the step."""


STEPS = {
    step.name: step
    for step in (
        Step(
            'runtime',
            'ROS 2 Jazzy, numpy, matplotlib',
            ('requirements/runtime.txt',),
            92,
            265,
            'ros-jazzy-rclpy',
        ),
        Step(
            'interfaces',
            'ROS messages, built with CMake',
            ('interfaces/requirements-build.txt',),
            30,
            26,
            'scikit-build-core',
        ),
        Step('driver', 'epson_driver', (), 0, 0),
        Step('panel', 'browser panel', ('requirements/panel.txt',), 11, 39, 'viser'),
        Step('planning', 'planner', ('requirements/planning.txt',), 122, 262, 'py-opw-kinematics'),
        Step(
            'dev',
            'test tools, planner, mesh tools, panel',
            ('requirements/dev.txt',),
            180,
            445,
            'py-opw-kinematics',
        ),
        Step('browser', 'what drives a browser', ('requirements/browser.txt',), 52, 164, 'viser'),
        Step('docs', 'builder of the site', ('requirements/docs.txt',), 33, 130, 'zensical'),
        Step('bench', 'what is compared, panel', ('requirements/bench.txt',), 129, 285, 'scipy'),
    )
}

# Not needed once installed: headers and static libraries (nothing is compiled against the
# planner), CMake (only messages are built with it), and the large packages' own tests.
BUILD_ONLY = ('cmake', 'ninja')
SURPLUS = ('cmeel.prefix/include', 'numpy/**/tests', 'scipy/**/tests', 'matplotlib/tests')

HINTS = (
    ('No space left on device|Errno 28|[Qq]uota exceeded', 'The disk is full: make room.'),
    (
        r'this machine lacks|No CMAKE_C|Python\.h|CompileError|(cc|g\+\+|clang).* failed',
        'Building failed: a C and a C++ compiler and the headers of Python are needed (Debian, '
        'Ubuntu: apt install build-essential python3-dev; macOS: xcode-select --install).',
    ),
    (
        'CERTIFICATE_VERIFY_FAILED|SSLError|SSLCertVerificationError',
        "The index's certificate was refused: PIP_CERT=FILE names the certificates to trust.",
    ),
    (
        'Failed to establish|name resolution|Name or service|Network is unreachable|refused|'
        'ProxyError|[Tt]imed out|Max retries|Connection broken|ConnectionReset|IncompleteRead',
        'The package index could not be reached, or not to the end: check the network, and for a '
        'mirror or a proxy PIP_INDEX_URL and HTTPS_PROXY. What came complete is not loaded again.',
    ),
    (
        'No matching distribution found for ros-|satisfies the requirement ros-',
        'PyPI has no ROS 2 Jazzy for {system}. It has it for Linux on x86-64 with glibc 2.28 or '
        'newer and Python 3.10 to 3.14. Elsewhere install ROS 2 Jazzy itself, and build with '
        'colcon (README.md).',
    ),
    (
        'No matching distribution found',
        'A package has no file for {system}; the last lines of pip name it. '
        'Another Python may do: make PYTHON=...',
    ),
    (
        'DO NOT MATCH THE HASHES|BadZipFile',
        'A download is damaged (pip cache purge), or the index has another file of that name than '
        f'the one that {HASHES} lists: then do not install it.',
    ),
    (
        '--require-hashes mode',
        f'{HASHES} lacks a package that is needed: make hashes writes it anew.',
    ),
    ('Permission denied', f'{VENV} cannot be written to: whose is it?'),
)
NO_HINT = 'Run make again; if it ends the same way, start from the beginning: make clean.'


class CannotInstallError(Exception):
    """What is wrong and what to do about it, for the user."""


def hint(output: str) -> str:
    """Return what to do about a failure, from the output of pip."""
    python = f'Python {platform.python_version()}'
    system = f'{platform.system()} on {platform.machine()} with {python}'
    for pattern, sentence in HINTS:
        if re.search(pattern, output):
            return f'{sentence.format(system=system)} Then run make again.'
    return NO_HINT


def missing(free: float, needed: float) -> Iterator[str]:
    """Yield what this machine lacks, a sentence each; free and needed: disk space, MB."""
    debian = 'Debian, Ubuntu: apt install'
    for name, variable in (('cc', 'CC'), ('c++', 'CXX')):
        compiler = (shlex.split(os.environ.get(variable, '')) or [name])[0]
        if shutil.which(compiler) is None:
            yield (
                f'no {compiler}: the ROS messages need a C and a C++ compiler '
                f'({debian} build-essential; macOS: xcode-select --install)'
            )
    version = f'python{sys.version_info.major}.{sys.version_info.minor}'
    header = Path(sysconfig.get_path('include'), 'Python.h')
    if not header.is_file():
        yield f'no {header}: the headers of Python ({debian} {version}-dev)'
    if importlib.util.find_spec('ensurepip') is None:
        yield f'no ensurepip in {sys.executable} ({debian} {version}-venv)'
    if free < needed:
        yield f'{free:.0f} MB free on the disk of {ROOT}: {needed:.0f} MB are needed'


# --- Output of pip ----------------------------------------------------------------------------
UNITS = {'bytes': 1e-6, 'kB': 1e-3, 'MB': 1.0, 'GB': 1e3}
FILE = re.compile(r'\s*(Downloading|Using cached) (\S+) \(([\d.]+) (bytes|kB|MB|GB)\)')
LOCAL = re.compile(r'\s*Processing (\S+\.whl)')  # an index on this machine
PROGRESS = re.compile(r'Progress (\d+) of (\d+)')
UNPACKING = re.compile(r'Installing collected packages: (.*)')
BUILDING = re.compile(r'\s*(?:Building wheel for|Building editable for) (\S+)')
SATISFIED = re.compile(r'Requirement already satisfied: ([A-Za-z0-9._-]+)')


class Pip:
    """The progress of pip, from the lines that it prints."""

    def __init__(self) -> None:
        self.downloaded = 0.0
        """Size of the files that came, from the index or from pip's cache, MB."""
        self.part = 0.0
        """Downloaded of the current file, MB."""
        self.unpacking = 0
        """Number of packages being unpacked."""
        self.doing = ''
        self.satisfied: set[str] = set()
        self._size = 0.0

    def line(self, text: str) -> bool:
        """Take in a line; return whether it is worth keeping."""
        if match := PROGRESS.match(text):
            self.part = int(match[1]) / MEGABYTE
            return False
        self.downloaded += self._size
        self._size = self.part = 0.0
        if match := FILE.match(text):
            if not match[2].endswith('.metadata'):
                self._size = float(match[3]) * UNITS[match[4]]
                self.doing = re.split(r'-\d', match[2])[0]
        elif (match := LOCAL.match(text)) and Path(match[1]).is_file():
            self._size = Path(match[1]).stat().st_size / MEGABYTE
            self.doing = re.split(r'-\d', Path(match[1]).name)[0]
        elif match := UNPACKING.match(text):
            self.unpacking = len(match[1].split(','))
            self.doing = 'unpacking'
        elif match := BUILDING.match(text):
            self.doing = f'building {match[1]}'
        elif match := SATISFIED.match(text):
            self.satisfied.add(match[1].lower().replace('_', '-'))
        return True


# --- Progress -----------------------------------------------------------------------
class Bar:
    """A progress line that is redrawn on a terminal while a step runs; elsewhere a plain line."""

    def __init__(self, title: str, sizes: str, stream: IO[str]) -> None:
        self.live = stream.isatty() and os.environ.get('TERM') != 'dumb'
        self._title, self._sizes, self._stream = title, sizes, stream
        self._begin = time.monotonic()
        self._drawn = -1.0
        self._say(f'{title}{sizes}', end='' if self.live else '\n')

    def _say(self, text: str, end: str) -> None:
        if self.live:
            width = shutil.get_terminal_size().columns
            text = f'\r\x1b[K{text[: width - 1]}'
        self._stream.write(text + end)
        self._stream.flush()

    def draw(self, share: float | None, doing: str) -> None:
        """Show the share that is done, 0 to 1 (None: unknown), and the current activity."""
        passed = time.monotonic() - self._begin
        if not self.live or passed < self._drawn + 0.1:
            return
        self._drawn = passed
        if share is None:
            drawn = '|/-\\'[int(passed * 5) % 4]
        else:
            full = int(24 * min(max(share, 0.0), 1.0))
            drawn = f'[{"#" * full}{"." * (24 - full)}]'
        minutes, seconds = divmod(int(passed), 60)
        self._say(f'{self._title} {drawn} {minutes}:{seconds:02} {doing}', end='')

    def end(self, well: bool) -> None:
        """Write the final form of the line."""
        if self.live:
            result = f'{time.monotonic() - self._begin:.0f} s' if well else 'failed'
            self._say(f'{self._title}{self._sizes}: {result}', end='\n')


def unknown() -> None:
    """Return the share that is done where it cannot be measured: None."""


def run(
    commands: Sequence[Sequence[str]],
    bar: Bar,
    seen: Pip | None = None,
    share: Callable[[], float | None] = unknown,
) -> None:
    """Run commands side by side; raise CannotInstallError with their output if one fails."""
    seen = seen or Pip()
    environment = os.environ | {'PYTHONUNBUFFERED': '1', 'PIP_NO_INPUT': '1'}
    for name in ('PIP_QUIET', 'PIP_VERBOSE'):  # class Pip reads the normal output
        environment.pop(name, None)
    with contextlib.ExitStack() as stack:
        selector = stack.enter_context(selectors.DefaultSelector())
        log = stack.enter_context((VENV / 'install.log').open('a', encoding='utf-8'))
        processes = []
        for command in commands:
            log.write(f'$ {shlex.join(command)}\n')
            process = stack.enter_context(
                subprocess.Popen(  # noqa: S603 our own words
                    command,
                    cwd=ROOT,
                    env=environment,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                )
            )
            kept: list[str] = []
            processes.append((process, kept))
            assert process.stdout is not None  # noqa: S101 it is a pipe
            selector.register(process.stdout, selectors.EVENT_READ, (kept, bytearray()))
        while selector.get_map():
            for key, _ in selector.select(0.2 if bar.live else None):
                kept, rest = key.data
                data = os.read(key.fd, 65536)
                if not data:
                    selector.unregister(key.fileobj)
                    data = b'\n' if rest else b''
                *lines, last = (bytes(rest) + data).split(b'\n')
                rest[:] = last
                for line in lines:
                    text = line.decode(errors='replace').rstrip('\r')
                    if seen.line(text):
                        kept.append(text)
                        log.write(text + '\n')
            bar.draw(share(), seen.doing)
        for process, kept in processes:
            if process.wait():
                output = '\n'.join(kept)
                raise CannotInstallError(f'{output}\n\n{hint(output)}')


# --- The environment --------------------------------------------------------------------------
def python() -> str:
    """Return the environment's interpreter."""
    return str(VENV / 'bin' / 'python')


def pip(*arguments: str) -> list[str]:
    """Return a command that runs the environment's pip."""
    return [python(), '-m', 'pip', '--disable-pip-version-check', *arguments]


def packages(*arguments: str) -> list[str]:
    """Return a command that installs; byte code is made when a module is first used."""
    options = ('--no-compile', '--progress-bar=raw', '-c', CONSTRAINTS)
    return pip('install', *options, *arguments)


def site_packages() -> Path:
    """Return the folder of the environment's Python packages."""
    (folder,) = VENV.glob('lib/python3*/site-packages')
    return folder


def pinned(name: str) -> str:
    """Return a requirement for the pinned version, with the hashes of its files."""
    text = (ROOT / HASHES).read_text(encoding='utf-8')
    (requirement,) = re.findall(rf'(?m)^{re.escape(name)}==(?:.*\\\n)*.*$', text)
    return f'{requirement}\n'


def disk_use(folder: Path) -> float:
    """Return the size of all files in a folder, each once however many names it has, MB."""
    sizes = {}
    for path in folder.rglob('*'):
        status = path.lstat()
        sizes[status.st_dev, status.st_ino] = status.st_blocks * 512
    return sum(sizes.values()) / MEGABYTE


def slim() -> None:
    """Remove what nothing here uses, and link files that are identical.

    Wheels cannot hold links: a library with three names comes as three files.
    """
    site = site_packages()
    for pattern in SURPLUS:
        for folder in list(site.glob(pattern)):
            shutil.rmtree(folder, ignore_errors=True)
    for archive in site.rglob('*.a'):
        archive.unlink()
    alike = defaultdict(list)
    for path in VENV.rglob('lib*.so*'):
        if path.is_file() and not path.is_symlink():
            alike[path.stat().st_size].append(path)
    for paths in (group for group in alike.values() if len(group) > 1):
        first: dict[bytes, Path] = {}
        for path in paths:
            with path.open('rb') as file:
                digest = hashlib.file_digest(file, 'sha256').digest()
            kept = first.setdefault(digest, path)
            if not path.samefile(kept):
                spare = path.with_name(path.name + '.link')
                spare.hardlink_to(kept)
                spare.replace(path)


# --- The steps --------------------------------------------------------------------------------
def announce(names: Sequence[str], stream: IO[str]) -> None:
    """Say how much will be downloaded and stored, before the download begins."""
    download = sum(STEPS[name].download for name in names)
    disk = sum(STEPS[name].disk for name in names)
    lacking = list(missing(shutil.disk_usage(ROOT).free / MEGABYTE, DISK_MARGIN * disk))
    if lacking:
        raise CannotInstallError('This machine lacks:\n  ' + '\n  '.join(lacking))
    stream.write(
        f'Installing into {VENV.name}: about {download} MB to download, {disk} MB on disk\n'
    )
    stream.flush()


def install(name: str, bar: Bar) -> Pip:
    """Install the requirements of a step."""
    step = STEPS[name]
    seen = Pip()
    seen.doing = 'looking up versions'
    before = 0

    def share() -> float | None:
        nonlocal before
        if seen.unpacking:
            there = sum(1 for _ in site_packages().glob('*.dist-info'))
            before = before or there
            return 0.75 + 0.25 * (there - before) / seen.unpacking
        return 0.75 * (seen.downloaded + seen.part) / max(step.download, 1)

    files = (word for file in step.files for word in ('-r', file))
    run([packages('-c', HASHES, *files)], bar, seen, share)
    slim()
    return seen


def runtime(bar: Bar) -> Pip:
    """Make the environment with the pinned pip, and install what the driver runs on."""
    bar.draw(None, 'making the environment')
    if not Path(python()).exists():
        venv.EnvBuilder(symlinks=True, with_pip=True).create(VENV)
    itself = VENV / 'pip.txt'  # the pip that comes with Python knows no hashes in constraints
    itself.write_text(pinned('pip'), encoding='utf-8')
    run([pip('install', '--no-compile', '--progress-bar=off', '-r', str(itself))], bar)
    return install('runtime', bar)


def interfaces(bar: Bar) -> Pip:
    """Build the message packages, side by side, and install them."""
    seen = install('interfaces', bar)
    wheels = VENV / 'wheels'
    shutil.rmtree(wheels, ignore_errors=True)
    builds = [
        pip(
            'wheel', '--no-build-isolation', '--no-deps', '-w', str(wheels), f'./interfaces/{name}'
        )
        for name in INTERFACES
    ]
    building = Pip()
    building.doing = f'building {", ".join(INTERFACES)}'
    run(builds, bar, building)
    files = [str(path) for path in sorted(wheels.glob('*.whl'))]
    run([packages('--no-deps', '--force-reinstall', *files)], bar)
    run([pip('uninstall', '--yes', *BUILD_ONLY)], bar)
    shutil.rmtree(wheels)
    return seen


def driver(bar: Bar) -> Pip:
    """Install this package."""
    shutil.rmtree(ROOT / 'build', ignore_errors=True)
    run([packages('--no-build-isolation', '--no-deps', '.')], bar)
    return Pip()


SPECIAL = {'runtime': runtime, 'interfaces': interfaces, 'driver': driver}


def carry_out(name: str, stream: IO[str]) -> None:
    """Do a step, and leave its stamp: what it took, if nothing of it was there before."""
    step = STEPS[name]
    before = disk_use(VENV) if VENV.exists() else 0.0
    sizes = f' ({step.download} MB to download, {step.disk} MB on disk)' if step.download else ''
    bar = Bar(step.title, sizes, stream)
    well = False
    try:
        seen = SPECIAL[name](bar) if name in SPECIAL else install(name, bar)
        well = True
    finally:
        bar.end(well)
    took = {}
    if step.files and step.alone not in seen.satisfied:
        took = {'download': round(seen.downloaded, 1), 'disk': round(disk_use(VENV) - before, 1)}
    (VENV / f'.{name}').write_text(json.dumps(took) + '\n', encoding='utf-8')


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out a step for make."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('step', choices=STEPS)
    parser.add_argument('--all', nargs='*', choices=STEPS, help='say what these will take, first')
    options = parser.parse_args(arguments)
    try:
        if options.all:
            announce(options.all, sys.stdout)
        carry_out(options.step, sys.stdout)
    except CannotInstallError as error:
        print(error, file=sys.stderr)
        return 1
    except (OSError, subprocess.CalledProcessError) as error:
        print(f'{error}\n\n{hint(str(error))}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('interrupted: make goes on from here', file=sys.stderr)
        return 130
    return 0


if __name__ == '__main__':
    sys.exit(main())
