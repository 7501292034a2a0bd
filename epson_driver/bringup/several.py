# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Several robots from two lists; the prefix of each is made from its namespace."""

from dataclasses import dataclass

from epson_driver.bringup.description import BringupError


@dataclass(frozen=True)
class Robot:
    """One of several robots, by the launch arguments in which it differs from the others."""

    namespace: str
    tf_prefix: str
    robot_ip: str


def several_robots(namespaces: str, robot_ips: str) -> list[Robot]:
    """Return one robot per namespace. Raises BringupError if the lists do not match."""
    names = [word.strip() for word in namespaces.split(',')]
    addresses = [word.strip() for word in robot_ips.split(',')]
    if '' in names or len(set(names)) != len(names):
        raise BringupError(
            f'namespaces = {namespaces}: each must have a name, and no two the same'
        )
    if len(addresses) != len(names):
        raise BringupError(
            f'robot_ips has {len(addresses)} addresses, but namespaces has {len(names)} names'
        )
    return [
        Robot(name, name.strip('/').replace('/', '_') + '_', address)
        for name, address in zip(names, addresses, strict=True)
    ]
