# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Configuration of a driver: address and properties of the controller, smoothing of goals."""

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
    """Address and properties of the controller. An I/O or remote port of 0 is not used.

    * `byte_order`: of all messages; None: `usual_byte_order` until a message shows another.
    * `errors`: texts of error numbers; None: EPSON's.
    * `delivery`: how trajectories are sent.
    * `mapping`: conversion of joint values; None: the controller uses the ROS convention.
    * `io`: I/O points and how to access them.
    * `motors`: how motors are switched and errors reset.
    * `state_period`: initial estimate of the time between two state messages, s.
    * `margins`: tolerances for reported joints beyond `limits`.
    * `configured_as`: controller and robot model, for texts.
    * `client_timeout`: the controller stops the arm if the driver sends nothing for this time, s;
      0: it does not.
    * `password`: for Remote Ethernet, if the controller runs no program.
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
        """Whether only Remote Ethernet is used, because the controller runs no program."""
        return self.delivery.interface == 'statements'

    @property
    def knows_byte_order(self) -> bool:
        """Whether the byte order is configured, or not needed because messages are text."""
        return self.statements or self.byte_order is not None

    @property
    def joint_mapping(self) -> JointMapping:
        """The configured joint mapping, or the identity."""
        return self.mapping or unmapped(len(self.limits.names))

    @property
    def state_rules(self) -> StateRules:
        """Rules for the controller's state messages."""
        return StateRules(
            self.state_period, self.limits, self.margins, self.state_timeout, self.statements
        )

    @property
    def address(self) -> tuple[str, int]:
        """Host and port of the server that moves the arm."""
        return self.host, self.remote_port if self.statements else self.motion_port
