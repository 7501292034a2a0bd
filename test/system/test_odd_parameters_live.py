# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the running node with odd values of every type: refused, and it goes on."""

import math
from typing import Any

import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import (
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from support.cell import Cell

from epson_driver.node.parameters import TABLE, joint_rows

OF_TRACES = ('trace_file',)  # a name of a file here makes a file
ROWS = {row.name: row for row in (*TABLE, *joint_rows('joint_1'))}

ODD = (
    ParameterValue(type=0),
    ParameterValue(type=99),
    *(ParameterValue(type=1, bool_value=value) for value in (False, True)),
    *(
        ParameterValue(type=2, integer_value=value)
        for value in (0, -1, 2**31, 2**63 - 1, -(2**63))
    ),
    *(
        ParameterValue(type=3, double_value=value)
        for value in (math.nan, math.inf, -math.inf, 1e300, -1e300, 5e-324, -5e-324, -0.0, -1.0)
    ),
    *(
        ParameterValue(type=4, string_value=value)
        for value in ('', ' ', 'x' * 100_000, 'a\nb', 'ä🤖', '../x', '1e300', 'nan')
    ),
    ParameterValue(type=5, byte_array_value=[b'\x00', b'\xff']),
    ParameterValue(type=6, bool_array_value=[True]),
    ParameterValue(type=7, integer_array_value=[]),
    ParameterValue(type=7, integer_array_value=[2**63 - 1]),
    ParameterValue(type=8, double_array_value=[math.nan]),
    ParameterValue(type=9, string_array_value=['', '']),
    ParameterValue(type=9, string_array_value=[]),
)

FIELDS = {1: 'bool_value', 2: 'integer_value', 3: 'double_value', 4: 'string_value'}


class Values:
    """The node's parameters through its services."""

    def __init__(self, cell: Cell) -> None:
        self._peer = cell.peer
        self._clients = {
            kind: cell.peer.node.create_client(kind, f'/epson_driver/{name}')
            for kind, name in (
                (SetParameters, 'set_parameters'),
                (SetParametersAtomically, 'set_parameters_atomically'),
                (GetParameters, 'get_parameters'),
                (ListParameters, 'list_parameters'),
            )
        }

    def _call(self, request: Any, kind: Any) -> Any:
        client = self._clients[kind]
        assert client.wait_for_service(30.0)
        return self._peer.complete(client.call_async(request))

    def set(self, name: str, values: tuple[ParameterValue, ...]) -> Any:
        parameters = [Parameter(name=name, value=value) for value in values]
        return self._call(SetParameters.Request(parameters=parameters), SetParameters).results

    def set_all(self, name: str, values: tuple[ParameterValue, ...]) -> Any:
        parameters = [Parameter(name=name, value=value) for value in values]
        request = SetParametersAtomically.Request(parameters=parameters)
        return self._call(request, SetParametersAtomically).result

    def get(self, name: str) -> ParameterValue:
        return self._call(GetParameters.Request(names=[name]), GetParameters).values[0]

    def names(self) -> list[str]:
        return list(self._call(ListParameters.Request(), ListParameters).result.names)

    def list_oddly(self) -> None:
        for prefixes, depth in ((['', '.', 'a..b', 'constraints.'], 2**64 - 1), (['x' * 9999], 1)):
            request = ListParameters.Request(prefixes=prefixes, depth=depth)
            self._call(request, ListParameters)


@pytest.mark.invariant(7)
def test_inv7_an_odd_value_is_refused_with_a_reason_and_the_node_goes_on(make_cell: Any) -> None:
    cell = make_cell().ready()
    values = Values(cell)
    for name in values.names():
        if name in OF_TRACES:
            continue
        before = values.get(name)
        row = ROWS.get(name)
        for odd, result in zip(ODD, values.set(name, ODD), strict=True):
            said = f'{name} = {str(odd)[:200]}: {result.reason[:200]}'
            if not result.successful:
                assert result.reason, said
                continue
            assert odd.type == before.type, said
            if row is None:  # use_sim_time and the like
                continue
            assert row.now, said
            value = getattr(odd, FIELDS[odd.type])
            if row.low is not None and row.high is not None:
                assert row.low <= value <= row.high, said
        assert not values.set_all(name, ODD).successful
        held = values.get(name)
        assert held.type == before.type
        if row is not None:
            assert values.set(name, (before,))[0].successful == row.now
    assert values.set('no_such_parameter', ODD[2:4])[0].reason
    values.list_oddly()
    cell.peer.enable()
    assert len(cell.peer.joint_states)
    cell.client.check_alive()
    assert 'Traceback' not in cell.client.log_text()
    assert cell.client.end() == 0
