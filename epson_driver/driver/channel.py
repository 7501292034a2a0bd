# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Creation of the links, motors and I/O of a controller, according to its profile."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial

from epson_driver.driver.configuration import Configuration
from epson_driver.driver.delivery.delivery import Delivery, DeliveryRules
from epson_driver.driver.delivery.download import Download
from epson_driver.driver.delivery.real_time import RealTimeDelivery
from epson_driver.driver.delivery.statements import StatementDelivery
from epson_driver.driver.delivery.streaming import FullStreaming, MotomanDelivery, Streaming
from epson_driver.driver.io.io_client import Io, make_io
from epson_driver.driver.stopping.motors import (
    MotomanMotors,
    Motors,
    MotorsByHand,
    MotorsKind,
    RemoteEthernetMotors,
    RestartingMotors,
    RtmcMotors,
    SerializedMotors,
)
from epson_driver.link import Link, LinkState
from epson_driver.link.remote_link import RemoteLink
from epson_driver.link.rtmc_link import RtmcLink
from epson_driver.remote_ethernet.client import Login, RemoteTurns
from epson_driver.rtmc.transport import connect
from epson_driver.simple_message import CommType, Dialect, Packet


@dataclass(frozen=True)
class Channel:
    state_link: Link
    motion_link: Link
    delivery: Delivery
    motors: SerializedMotors
    io: Io

    @property
    def links(self) -> tuple[Link, ...]:
        """The state and motion links, or one link if it serves both."""
        return tuple(dict.fromkeys((self.state_link, self.motion_link)))

    @property
    def all_links(self) -> list[Link]:
        return [*self.links, *([] if self.io.link is None else [self.io.link])]


OnPacket = Callable[[Packet], None]
OnLink = Callable[[str, LinkState, str], None]
"""on_link(name, state, why) is called when a link changes its state. `why`: the reason."""


def make_channel(
    configuration: Configuration,
    on_state_packet: OnPacket,
    on_motion_packet: OnPacket,
    on_link: OnLink,
    before_motion_link: Callable[[], Awaitable[object]],
) -> Channel:
    """Return the links to a controller, its motors, its I/O, and the delivery of points."""
    host, ports = configuration.host, (configuration.io_port, configuration.remote_port)
    turns = RemoteTurns()
    login: Login | None = None
    state: Link
    motion: Link
    if configuration.statements:
        state = motion = remote = RemoteLink(
            host,
            configuration.remote_port,
            configuration.limits.units,
            on_packet=on_state_packet,
            on_state=partial(on_link, 'remote'),
            password=configuration.password,
            period=configuration.state_period,
            timeout=configuration.state_timeout,
        )
        login = remote.session
    elif configuration.real_time:

        def on_packet(packet: Packet) -> None:
            topic = packet.comm_type is CommType.TOPIC
            (on_state_packet if topic else on_motion_packet)(packet)

        state = motion = RtmcLink(
            host,
            configuration.motion_port,
            configuration.limits,
            configuration.model,
            on_packet=on_packet,
            on_state=partial(on_link, 'rtmc'),
            password=configuration.password,
            cycle=configuration.cycle,
            period=configuration.state_period,
            timeout=configuration.state_timeout,
            errors=configuration.errors,
            connect=connect,
        )
    else:
        state = Link(
            'state',
            host,
            configuration.state_port,
            on_packet=on_state_packet,
            on_state=partial(on_link, 'state'),
            receive_timeout=configuration.state_timeout,
            byte_order=configuration.byte_order,
        )
        motion = Link(
            'motion',
            host,
            configuration.motion_port,
            on_packet=on_motion_packet,
            on_state=partial(on_link, 'motion'),
            byte_order=configuration.byte_order,
            before_connecting=before_motion_link,
        )
        if configuration.byte_order is None:
            state.dialect = motion.dialect = Dialect(configuration.usual_byte_order)
    delivery = _delivery(configuration.delivery)(
        motion, configuration.limits, configuration.joint_mapping, configuration.delivery
    )
    return Channel(
        state,
        motion,
        delivery,
        SerializedMotors(make_motors(configuration.motors, host, ports[1], motion, turns, login)),
        make_io(
            configuration.io,
            host,
            ports,
            byte_order=configuration.byte_order,
            timeout=configuration.io_timeout,
            turns=turns,
            login=login,
            motion_link=motion,
        ),
    )


def _delivery(rules: DeliveryRules) -> type[Delivery]:
    if rules.interface == 'statements':
        return StatementDelivery
    if rules.interface == 'rtmc':
        return RealTimeDelivery
    if rules.interface == 'download':
        return Download
    if rules.motoman:
        return MotomanDelivery
    return FullStreaming if rules.point_message == 'joint_traj_pt_full' else Streaming


def make_motors(
    kind: MotorsKind,
    host: str,
    remote_port: int,
    motion_link: Link,
    turns: RemoteTurns | None = None,
    login: Login | None = None,
) -> Motors:
    """Return the object that switches the controller's motors and resets its errors.

    `login`: opens a shared session on the remote port. None: each action logs in separately.
    """
    if kind == 'motoman':
        return MotomanMotors(motion_link)
    if isinstance(motion_link, RtmcLink):
        return RtmcMotors(motion_link)
    if kind == 'none':
        return MotorsByHand('the controller does not support this command')
    if not remote_port:
        return MotorsByHand('the port of Remote Ethernet is 0')
    if kind == 'restart':
        return RestartingMotors(host, remote_port, turns)
    return RemoteEthernetMotors(host, remote_port, turns, login)
