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
    """Address and properties of the controller. An I/O or remote port of 0 is not used."""

    host: str
    motion_port: int
    state_port: int
    remote_port: int
    byte_order: ByteOrder | None  # None: `usual_byte_order` until a message shows another
    state_timeout: float
    limits: JointLimits
    smoothing: Smoothing = NO_SMOOTHING
    errors: ErrorTexts | None = None  # texts of error numbers; None: EPSON's
    delivery: DeliveryRules = STREAMING  # how trajectories are sent
    mapping: JointMapping | None = None  # None: the controller uses the ROS convention
    usual_byte_order: ByteOrder = ByteOrder.LITTLE
    io_port: int = 0
    io_timeout: float = 1.0
    io: IoProfile = USUAL_IO  # I/O points and how to access them
    motors: MotorsKind = 'remote_ethernet'  # how motors are switched and errors reset
    state_period: float = 0.005  # initial estimate of the time between two state messages, s
    margins: Margins = DEFAULT_MARGINS  # tolerances for reported joints beyond `limits`
    configured_as: str = ''  # controller and robot model, for texts
    client_timeout: float = 0.0  # silence after which the controller stops the arm, s; 0: none
    password: str = ''  # for Remote Ethernet or Real-time Motion Control, without a program
    model: str = ''  # name of the robot model, which Real-time Motion Control checks
    cycle: float = 0.002  # time between two targets of Real-time Motion Control, s

    def __post_init__(self) -> None:
        if self.statements and not self.remote_port:
            raise ValueError('remote_port = 0: must be a port, as only Remote Ethernet is used')
        if self.real_time and not self.joint_mapping.identity:
            raise ValueError(
                'parameters joint_signs, joint_offsets, j23_factor: EPSON controllers use the '
                'convention of ROS'
            )

    @property
    def statements(self) -> bool:
        """Whether the driver sends SPEL+ statements, because the controller runs no program."""
        return self.delivery.interface == 'statements'

    @property
    def real_time(self) -> bool:
        """Whether Real-time Motion Control is used, at `motion_port`."""
        return self.delivery.interface == 'rtmc'

    @property
    def knows_byte_order(self) -> bool:
        """Whether the byte order is configured, or the protocol does not depend on it."""
        return self.statements or self.real_time or self.byte_order is not None

    @property
    def joint_mapping(self) -> JointMapping:
        return self.mapping or unmapped(len(self.limits.names))

    @property
    def state_rules(self) -> StateRules:
        return StateRules(
            self.state_period,
            self.limits,
            self.margins,
            self.state_timeout,
            on_request=self.statements or self.real_time,
        )

    @property
    def address(self) -> tuple[str, int]:
        return self.host, self.remote_port if self.statements else self.motion_port
