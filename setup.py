# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An ament_python package that is a plain Python package as well.

colcon (`setup.py install|develop`) makes lib/epson_driver/NAME from entry points. A wheel gets
one command, `epson_driver`, so that no `client` or `demo` lands in a user's bin/; its
lib/epson_driver/ holds launchers (scripts/), so that `ros2 run` works over a pip environment too.
"""

import os
import sys
from pathlib import Path

from setuptools import find_packages, setup

NAME = 'epson_driver'
EXECUTABLES = ('client', 'demo', 'pendant', 'sim_controller')
BY_COLCON = not {'install', 'develop'}.isdisjoint(sys.argv)


def data_files():
    """Return (target folder, files) for everything that is installed beside the code."""
    yield 'share/ament_index/resource_index/packages', [f'resource/{NAME}']
    yield f'share/{NAME}', ['package.xml']
    for top in filter(os.path.isdir, ('config', 'urdf', 'launch')):
        for folder in [Path(top), *(p for p in sorted(Path(top).rglob('*')) if p.is_dir())]:
            files = [str(path) for path in sorted(folder.iterdir()) if path.is_file()]
            if files:
                yield f'share/{NAME}/{folder}', files
    if not BY_COLCON:
        yield f'lib/{NAME}', [f'scripts/{name}' for name in EXECUTABLES]


commands = [f'{NAME} = {NAME}.cli.__main__:main']
if BY_COLCON:
    commands += [f'{name} = {NAME}.cli.{name}:main' for name in EXECUTABLES]

setup(
    name=NAME,
    version='0.1.0',
    description='ROS 2 driver for EPSON and other simple-message robot controllers',
    long_description=Path('README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    license='Apache-2.0',
    maintainer='epson_driver developers',
    maintainer_email='epson-driver@example.org',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={NAME: ['py.typed']},
    python_requires='>=3.11',
    # ROS's own packages are not listed: on a ROS machine they are no Python distributions.
    # requirements/ros.txt has them for an environment without ROS.
    install_requires=['numpy', 'ruckig', 'PyYAML', 'rich'],
    extras_require={
        'report': ['matplotlib'],
        'dev': [
            'colcon-common-extensions',
            'hypothesis',
            'mypy',
            'pytest',
            'pytest-timeout',
            'ruff',
            'types-PyYAML',
        ],
    },
    data_files=list(data_files()),
    entry_points={'console_scripts': commands},
    zip_safe=False,
)
