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
    """Where the controller is and what it expects. An io or remote port of 0 is not used.

    `errors` says what its error numbers mean; None: they are EPSON's. `delivery` says how
    trajectories reach it, `io` which points it has and how they are reached, `mapping` how it
    counts joints; None: as ROS does. Where the byte order is not given, `usual_byte_order` holds
    until its messages show it. `motors`: how they are switched, and errors reset. `state_period`:
    s between two messages of its state, to begin with. `margins`: how far beyond `limits` its
    joints may be. `configured_as`: what kind of controller and robot that is, for people.
    `client_timeout`: how long the controller lets the arm move without a word from the driver, s;
    0: as long as it has points. `password`: of Remote Ethernet where that moves the arm.
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
            raise ValueError('remote_port = 0: this controller is reached by nothing else')

    @property
    def statements(self) -> bool:
        """Whether all goes by Remote Ethernet, as no program is in the controller."""
        return self.delivery.interface == 'statements'

    @property
    def knows_byte_order(self) -> bool:
        """Whether messages need not show it: it is given, or text has none."""
        return self.statements or self.byte_order is not None

    @property
    def joint_mapping(self) -> JointMapping:
        """The mapping, or that of a controller that counts joints as ROS does."""
        return self.mapping or unmapped(len(self.limits.names))

    @property
    def state_rules(self) -> StateRules:
        """What is expected of the controller's state."""
        return StateRules(
            self.state_period, self.limits, self.margins, self.state_timeout, self.statements
        )

    @property
    def address(self) -> tuple[str, int]:
        """Host and port of the server that moves the arm."""
        return self.host, self.remote_port if self.statements else self.motion_port
