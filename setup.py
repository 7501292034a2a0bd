# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An ament_python package that is also a plain Python package.

Both install scripts/NAME as lib/epson_driver/NAME, where `ros2 run` looks: colcon (`setup.py
install|develop`) as scripts, a wheel as data, so that no `client` or `demo` lands in a user's
bin/. The only command there is `epson_driver`.
"""

import os
import sys
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup  # before distutils, which it provides

from distutils.command.build_scripts import build_scripts  # isort: skip

NAME = 'epson_driver'
MANIFEST = ElementTree.parse(Path(__file__).with_name('package.xml')).getroot()  # noqa: S314 - our own
LAUNCHER = Path('scripts', 'executable')  # what the others are links to
EXECUTABLES = [str(path) for path in sorted(LAUNCHER.parent.iterdir()) if path != LAUNCHER]
OF_ROS = ('control_msgs', 'tf2_msgs')
INTERFACES = ('epson_msgs', 'industrial_msgs')
BY_COLCON = not {'install', 'develop'}.isdisjoint(sys.argv)


def data_files():
    """Yield (target folder, files) for everything that is installed beside the code."""
    yield 'share/ament_index/resource_index/packages', [f'resource/{NAME}']
    yield f'share/{NAME}', ['package.xml']
    for top in filter(os.path.isdir, ('config', 'urdf', 'launch', 'controller_program')):
        for folder in [Path(top), *(p for p in sorted(Path(top).rglob('*')) if p.is_dir())]:
            files = [str(path) for path in sorted(folder.iterdir()) if path.is_file()]
            if files:
                yield f'share/{NAME}/{folder}', files
    if not BY_COLCON:
        yield f'lib/{NAME}', EXECUTABLES


class BuildScripts(build_scripts):
    """Writes the interpreter into the scripts, which newer setuptools leave to pip."""

    def run(self):
        """Copy the scripts to the build folder, then rewrite their first lines."""
        super().run()
        for script in (Path(self.build_dir, Path(name).name) for name in self.scripts):
            _, rest = script.read_text(encoding='utf-8').split('\n', 1)
            script.write_text(f'#!{sys.executable}\n{rest}', encoding='utf-8')


def missing_packages():
    """Return the message packages that the driver needs and AMENT_PREFIX_PATH does not have."""
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    folders = [Path(prefix, 'share') for prefix in prefixes if prefix]
    return [
        name
        for name in (*OF_ROS, *INTERFACES)
        if not any((folder / name / 'package.xml').is_file() for folder in folders)
    ]


def report_missing_packages():
    """Print advice on missing message packages, without which the driver cannot start."""
    missing = missing_packages()
    if not missing:
        return
    here = Path(__file__).resolve().parent
    advice = []
    of_ros = [name for name in OF_ROS if name in missing]
    if of_ros:
        verb = 'comes' if len(of_ros) == 1 else 'come'
        advice.append(f'{" and ".join(of_ros)} {verb} with ROS 2 (rosdep install)')
    if not set(INTERFACES).isdisjoint(missing):
        advice.append(
            f'colcon must be told of {here.name}/interfaces, as it looks for no packages within '
            f'one: colcon build --base-paths {here} {here / "interfaces"}'
        )
    print(f'{NAME} needs {", ".join(missing)}: {"; ".join(advice)}', file=sys.stderr)


if BY_COLCON:
    report_missing_packages()

setup(
    name=NAME,
    version=MANIFEST.findtext('version'),
    description='ROS 2 driver and Python API for EPSON and other simple-message controllers',
    long_description=Path(__file__).with_name('README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    classifiers=[
        'Development Status :: 3 - Alpha',
        'Intended Audience :: Manufacturing',
        'Intended Audience :: Science/Research',
        'Programming Language :: Python :: 3.11',
        'Programming Language :: Python :: 3.12',
        'Programming Language :: Python :: 3.13',
        'Programming Language :: Python :: 3.14',
        'Topic :: Scientific/Engineering',
        'Typing :: Typed',
    ],
    license=MANIFEST.findtext('license'),
    url=MANIFEST.findtext("url[@type='repository']"),
    author=MANIFEST.findtext('author'),
    maintainer=MANIFEST.findtext('maintainer'),
    maintainer_email=MANIFEST.find('maintainer').get('email'),
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={NAME: ['py.typed', 'pages/assets/*', 'panel/assets/*', 'report/assets/*']},
    python_requires='>=3.11',
    # No ROS package is needed for the Python API. On a ROS machine rosdep brings them, and they
    # are not Python distributions; the extra `ros` is for an environment without ROS.
    install_requires=['numpy', 'ruckig', 'PyYAML', 'rich', 'xacro'],
    extras_require={
        'ros': [
            'ros-jazzy-rclpy[fastrtps]',
            'ros-jazzy-diagnostic-msgs',
            'ros-jazzy-sensor-msgs',
            'ros-jazzy-std-msgs',
            'ros-jazzy-std-srvs',
            'ros-jazzy-trajectory-msgs',
        ],
        'report': ['matplotlib', 'rosbags'],
        'panel': ['websockets>=14'],
        'editor': ['pygls>=2'],
        # The name that colcon looks for: without it, `colcon test` collects with unittest.
        'test': ['catkin-pkg', 'hypothesis', 'pytest', 'pytest-timeout', 'scipy'],
        'dev': [
            'catkin-pkg',
            'codespell',
            'colcon-common-extensions',
            'coverage',
            'hypothesis',
            'mypy',
            'pin',
            'pytest',
            'pytest-timeout',
            'pytest-xdist',
            'rosdep',
            'ruff',
            'scipy',
            'types-PyYAML',
        ],
    },
    data_files=list(data_files()),
    scripts=EXECUTABLES if BY_COLCON else [],
    cmdclass={'build_scripts': BuildScripts},
    entry_points={
        'console_scripts': [f'{NAME} = {NAME}.cli.__main__:main'],
        'ros2doctor.checks': [f'EpsonDriverCheck = {NAME}.cli.ros2_doctor:EpsonDriverCheck'],
    },
    zip_safe=False,
)
