# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Rules for sending trajectories to a controller, from its profile and the parameters."""

from epson_driver.driver.delivery.delivery import DeliveryRules, Interface
from epson_driver.profiles import ControllerProfile
from epson_driver.profiles.profile_rules import FieldsUsed

LOW_POWER = 0.05
"""Maximum speed in low power mode, as a fraction of full speed."""

WHOLE_PERCENT = 0.01
"""Minimum of the SPEL+ statement `Speed`, 1 %, as a fraction."""


def delivery_rules(
    profile: ControllerProfile, interface: Interface, message: str
) -> DeliveryRules:
    """Return the rules for a controller with this profile.

    `interface`, `message`: values of the driver's parameters `interface` and `point_message`.
    Raises ValueError if they do not fit the profile or each other.
    """
    motoman = profile.program.kind == 'motoman'
    full = message == 'joint_traj_pt_full'
    usual = profile.program.interface
    if 'statements' in (interface, usual) and interface != usual:
        raise ValueError(
            f'parameter interface = {interface}: the controller {profile.name} supports {usual}'
        )
    if interface == 'download' and full:
        raise ValueError(
            'parameter interface = download: points are downloaded as joint_traj_pt only, but '
            f'point_message = {message}'
        )
    if motoman and not full:
        raise ValueError(
            f'parameter point_message = {message}: the controller {profile.name} '
            'supports joint_traj_pt_full only'
        )
    download = profile.program.download
    return DeliveryRules(
        interface=interface,
        point_message='joint_traj_pt_full' if full else 'joint_traj_pt',
        motoman=motoman,
        uses=FieldsUsed(profile.program.uses),
        speed=min(profile.motion.speed, 1.0 if profile.motion.power == 'high' else LOW_POWER),
        buffer=download.buffer,
        dead_time=download.dead_time,
        power=profile.motion.power,
        announces_streams=profile.error_texts == 'epson',  # other programs may refuse it
        slowest=WHOLE_PERCENT if profile.spel.project or usual == 'statements' else 0.0,
    )
