# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The services that set parameters, for requests that rclpy's own end the node with.

rclpy (up to Rolling) raises ValueError in the executor for a value of a type that does not exist:
one request ends every entry point of the node.
"""

from typing import Any

from rcl_interfaces.msg import ParameterType, SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.parameter_service import ParameterService

TYPES = range(ParameterType.PARAMETER_NOT_SET, ParameterType.PARAMETER_STRING_ARRAY + 1)


class CheckedParameterService(ParameterService):  # type: ignore[misc]  # rclpy carries no types
    """A node's parameter services. Make the node with `start_parameter_services=False`."""

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        for each in request.parameters:
            refused = _refusal([each])
            if refused is None:
                alone = SetParameters.Request(parameters=[each])
                done = super()._set_parameters_callback(alone, SetParameters.Response())
                response.results += done.results
            else:
                response.results.append(refused)
        return response

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        refused = _refusal(request.parameters)
        if refused is None:
            return super()._set_parameters_atomically_callback(request, response)
        response.result = refused
        return response


def _refusal(parameters: Any) -> SetParametersResult | None:
    for each in parameters:
        if each.value.type not in TYPES:
            why = f'parameter {each.name}: {each.value.type} is not the number of a type'
            return SetParametersResult(successful=False, reason=why)
    return None
