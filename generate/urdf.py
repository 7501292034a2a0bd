# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Writes urdf/NAME.urdf of every model, for users without xacro.

python -m generate.urdf
"""

from pathlib import Path

import xacro

from epson_driver.robots import RobotModel
from epson_driver.share import share_folder
from generate.meshes import described_models

NOTE = (
    'Copyright 2026 the epson_driver developers. SPDX-License-Identifier: Apache-2.0\n'
    '     Made by generate/urdf.py from epson_robot.urdf.xacro and config/robots: do not edit.\n'
    '     Effort limits are placeholders, masses and inertias are estimates.'
)


def urdf(model: RobotModel, **arguments: str) -> str:
    """Return the URDF of a model; arguments: those of epson_robot.urdf.xacro."""
    source = share_folder('urdf') / 'epson_robot.urdf.xacro'
    document = xacro.process_file(str(source), mappings={'robot_model': model.name, **arguments})
    for node in list(document.childNodes):
        if node is not document.documentElement:  # xacro's comment, which has this machine's paths
            document.removeChild(node)
    document.insertBefore(document.createComment(f' {NOTE} '), document.documentElement)
    return str(document.toprettyxml(indent='  ')).replace(' ?><!--', ' ?>\n<!--')


def write(folder: Path, models: list[RobotModel]) -> None:
    """Write the plain URDF of each model."""
    for model in models:
        (folder / f'{model.name}.urdf').write_text(urdf(model), 'utf-8')


if __name__ == '__main__':
    write(share_folder('urdf'), described_models())
