# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Configuration of a driver: the controller's address and rules, and how goals are executed."""

from dataclasses import dataclass

from epson_driver.driver.delivery.delivery import DeliveryRules
from epson_driver.driver.smoothing import Smoothing
from epson_driver.driver.state.joint_mapping import JointMapping, unmapped
from epson_driver.driver.state.plausibility import DEFAULT_MARGINS, Margins
from epson_driver.driver.state.robot_state import StateRules
from epson_driver.driver.stopping.motors import MotorsKind
from epson_driver.error_texts import ErrorTexts
from epson_driver.motion import JointLimits
from epson_driver.profiles.io_profile import IoProfile
from epson_driver.simple_message import ByteOrder

NO_SMOOTHING = Smoothing()
STREAMING = DeliveryRules()
USUAL_IO = IoProfile()


@dataclass(frozen=True)
class Configuration:
    """Address, kind and expectations of the controller. An I/O or remote port of 0 is not used.

    `errors`: texts of its error numbers; None: EPSON's. `delivery`: how trajectories are sent.
    `io`: its I/O points and access to them. `mapping`: its joint convention; None: ROS's.
    `usual_byte_order`: used until messages show the byte order, if `byte_order` is None. `motors`:
    how motors are switched and errors reset. `state_period`: initial estimate of the time between
    two state messages, s. `margins`: how far beyond `limits` joints may be reported.
    `configured_as`: kind of controller and robot, for people. `client_timeout`: time for which the
    controller lets the arm move without a message from the driver, s; 0: until its points end.
    `password`: for Remote Ethernet, if that moves the arm.
    """

    host: str
    motion_port: int
    state_port: int
    remote_port: int
    byte_order: ByteOrder | None
    state_timeout: float
    limits: JointLimits
    smoothing: Smoothing = NO_SMOOTHING
    errors: ErrorTexts | None = None
    delivery: DeliveryRules = STREAMING
    mapping: JointMapping | None = None
    usual_byte_order: ByteOrder = ByteOrder.LITTLE
    io_port: int = 0
    io_timeout: float = 1.0
    io: IoProfile = USUAL_IO
    motors: MotorsKind = 'remote_ethernet'
    state_period: float = 0.005
    margins: Margins = DEFAULT_MARGINS
    configured_as: str = ''
    client_timeout: float = 0.0
    password: str = ''

    def __post_init__(self) -> None:
        if self.statements and not self.remote_port:
            raise ValueError('remote_port = 0: this controller has no other interface')

    @property
    def statements(self) -> bool:
        """Whether Remote Ethernet is used for everything, as the controller runs no program."""
        return self.delivery.interface == 'statements'

    @property
    def knows_byte_order(self) -> bool:
        """Whether the byte order is configured, or not needed because messages are text."""
        return self.statements or self.byte_order is not None

    @property
    def joint_mapping(self) -> JointMapping:
        """The configured mapping, or the identity."""
        return self.mapping or unmapped(len(self.limits.names))

    @property
    def state_rules(self) -> StateRules:
        """Expectations of the controller's state."""
        return StateRules(
            self.state_period, self.limits, self.margins, self.state_timeout, self.statements
        )

    @property
    def address(self) -> tuple[str, int]:
        """Host and port of the server that moves the arm."""
        return self.host, self.remote_port if self.statements else self.motion_port
