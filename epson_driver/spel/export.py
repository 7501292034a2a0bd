# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A complete RC+ project: programs, with every file that RC+ expects.

The layout follows projects written by RC+ 7.0.5 and 6.0.0, of which 52 public projects were
compared. Newer versions of RC+ are expected to convert these formats, because EPSON's own samples
are equally old. RC+ itself has not opened an exported project yet.
"""

import uuid
from collections.abc import Mapping
from datetime import datetime

from epson_driver.inputs.rc_files import CRLF, Block, parsed, quoted, sealed
from epson_driver.spel.project_data import INCLUDE, PROGRAM

RC_VERSIONS = {6: '6.0.0', 7: '7.0.5', 8: '7.0.5'}
"""Major version of RC+ → version whose project format is written."""

_SINCE_7 = {
    'sRCRevision', 'bGlobalsDeclaredEachFile', 'bSimulatorButton', 'bAllowReset', 'bPalletsTab',
}  # fmt: skip

_NAMESPACE = uuid.UUID('6f0bd8ae-6b0c-5b7e-9d0e-3f8a5c1d2e4b')
_LABELS = ('Bit', 'Byte', 'Word')
_ON, _OFF = 'True', 'False'
_OPERATOR = (
    ('RobotMgrButton', 'PauseContButtons', 'IOMonitorButton', 'SystemHistoryButton'),
    ('DisplayVision',),
    ('SimulatorButton',),
)
_MANAGER_ON = (
    'AllowReset AllowTeach AllowMotionCmds AllowDeletePoints AllowEditPoints AllowSFree AllowHome '
    'PromptNewPointInfo TeachDefinedOnly ControlPanelTab JogTab PointsTab'
)
_MANAGER_OFF = (
    'ArchTab LocalsTab ToolsTab ArmsTab PalletsTab ECPTab BoxesTab PlanesTab WeightTab InertiaTab '
    'XYZLimitsTab RangeTab HomeConfigTab MCalOrderTab'
)
_MONITOR = (('StandardViewTab', _ON), ('CustomView1Tab', _ON), ('CustomView2Tab', _OFF))
_MONITOR_OFF = (('CustomView3Tab', _OFF), ('AllowChangeOutputs', _OFF))


def exported(
    name: str, files: Mapping[str, str], version: int, when: datetime
) -> dict[str, bytes]:
    """Return the files of an RC+ project by name: `files`, and the other files that RC+ needs.

    `files` must be ASCII, `when` must have a time zone. The same arguments give the same bytes.
    """
    rc = RC_VERSIONS[version]
    guid = uuid.uuid5(_NAMESPACE, ''.join(f'{item}\n{text}' for item, text in files.items()))
    written = {item: text.replace('\n', CRLF) for item, text in files.items() if _is_text(item)}
    written |= {
        item: _of_version(rc, item, text, when)
        for item, text in files.items()
        if not _is_text(item)
    }
    blocks = {
        f'{name}.sprj': _known(rc, _project(name, list(files), rc, str(guid), when)),
        'IOLabels.dat': _io_labels(rc),
        'robot1.pts': Block('', [('sVersion', '"2.0.0"'), ('nNumberOfPoints', '0')]),
        f'{name}.vis': Block('', [('sGUID', quoted(_vision_id(guid))), ('nCameraNumber', '1')]),
    }
    written |= {item: sealed(block, when) for item, block in blocks.items() if item not in files}
    return {
        item: text.replace(CRLF, '\n').replace('\n', CRLF).encode('ascii')
        for item, text in written.items()
    }


def _is_text(name: str) -> bool:
    return name.lower().endswith((PROGRAM, INCLUDE))


def _project(name: str, files: list[str], rc: str, guid: str, when: datetime) -> Block:
    stamp = quoted(f'{when:%d-%m-%Y %H:%M:%S}')
    programs = [file for file in files if file.lower().endswith(PROGRAM)]
    includes = [file for file in files if file.lower().endswith(INCLUDE)]
    user = ['Version', 'Description', 'Notes', 'ParserEmulationVersion']
    return Block(
        '',
        [
            _block(
                'SystemProperties',
                sRCVersion=quoted(rc), sRCRevision='""', sGUID=quoted(guid), sPath='""',
                sCreated=stamp, sLastModified=stamp, bBuildComplete=_OFF,
                bFirstBuildComplete=_OFF, bRebuildRequired=_ON, bClearControllerProject=_OFF,
                bClearGlobalPreserves=_OFF,
            ),
            _block(
                'UserProperties',
                **{f's{item}': '""' for item in user},
                bStrictCompile=_OFF,
                bGlobalsDeclaredEachFile=_OFF,
            ),
            _block('IOLabelFile', sName='"IOLabels.dat"', nChecksum='0'),
            _block('UserErrorsFile', sName='"UserErrors.dat"', nChecksum='0'),
            ('nRobotCount', '1'),
            ('nProgramFileCount', str(len(programs))),
            *(
                _block(
                    f'ProgramFile{number}', sName=quoted(element), bCompiled=_OFF,
                    bStoreInController=_ON,
                )
                for number, element in enumerate(programs, 1)
            ),
            ('nIncludeFileCount', str(len(includes))),
            *(
                _block(f'IncludeFile{number}', sName=quoted(element), bStoreInController=_ON)
                for number, element in enumerate(includes, 1)
            ),
            ('nPointFileCount', '1'),
            _block('PointFile1', sName='"robot1.pts"', nRobot='1', bDefault=_ON),
            Block('OperatorSettings', [_operator_window(rc), _manager(), _monitor()]),
            *(
                _block(
                    f'IOCustomView{number}', sName='""', bVisible=_ON if number == 1 else _OFF,
                    nNumberOfRows='0',
                )
                for number in (1, 2, 3)
            ),
            ('nVisFileCount', '1'),
            _block('VisFile1', sName=quoted(f'{name}.vis')),
            ('nGuiBuilderFileCount', '0'),
        ],
    )  # fmt: skip


def _vision_id(guid: uuid.UUID) -> str:
    return str(uuid.uuid5(guid, 'vis'))


def _of_version(rc: str, name: str, text: str, when: datetime) -> str:
    block = parsed(name, text)
    if block.text('sRCVersion') == rc:
        return text
    block.items[:2] = [('sRCVersion', quoted(rc))]  # the header is the first one
    return sealed(block, when)


def _known(rc: str, block: Block) -> Block:
    if rc[0] != '6':
        return block
    items = (_known(rc, item) if isinstance(item, Block) else item for item in block.items)
    known = [item for item in items if isinstance(item, Block) or item[0] not in _SINCE_7]
    return Block(block.name, known)


def _block(name: str, **values: str) -> Block:
    return Block(name, list(values.items()))


def _operator_window(rc: str) -> Block:
    window = _block(
        'OperatorWindow', sTitle='"Operator Window"', nWinState='0', sFontName='"Courier New"',
        rFontSize='10', bFontBold=_OFF,
    )  # fmt: skip
    for names, value in zip(_OPERATOR, (_ON, _OFF, _ON), strict=True):
        window.items += [(f'b{name}', value) for name in names]
    for number in range(64 if rc[0] == '6' else 8):
        title = f'"Program {number}"' if number else '"Program"'
        window.items.append(_block(f'Program{number}', sName=title, bEnabled=_ON))
    return window


def _manager() -> Block:
    on = [(f'b{item}', _ON) for item in _MANAGER_ON.split()]
    return Block('RobotManager', [*on, *((f'b{item}', _OFF) for item in _MANAGER_OFF.split())])


def _monitor() -> Block:
    return Block('IOMonitor', [(f'b{item}', value) for item, value in (*_MONITOR, *_MONITOR_OFF)])


def _io_labels(rc: str) -> Block:
    none = [
        _block(f'{kind}{size}Labels', nNumberOfLabels='0')
        for kind in ('Input', 'Output', 'Memory')
        for size in _LABELS
    ]
    return Block('', [('sRCVersion', quoted(rc)), *none])
