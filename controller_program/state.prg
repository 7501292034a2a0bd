' The state server: sends joint positions and the status to one client.
' Copyright 2026 the epson_driver developers. SPDX-License-Identifier: Apache-2.0

#include "config.inc"
#include "messages.inc"
#include "globals.inc"

' The two messages, the received message, and the reply
Integer m_position(59), m_status(43), m_frame(1023), m_answer(63)
Long m_length
' For each joint, the index of the power of two that PackFloat last used: see bytes.prg
Integer m_place(5)
' Time at which the next message is due, on STATE_TIMER
Double m_due
' in_motion of the last status
Long m_moving

' A background task that never ends
Function StateServer
  OnErr GoTo state_error
  Do
    StateService
    Wait 0.1
  Loop
state_error:
  EResume Next
Fend

' Serves one client
Function StateService
  Integer i
  If ChkNet(STATE_PORT) <> -3 Then CloseNet #STATE_PORT
  SetNet #STATE_PORT, OWN_ADDRESS, STATE_TCP_PORT, CRLF, NONE, 2
  OpenNet #STATE_PORT As Server
  TmReset STATE_FRAME_TIMER
  Do While ChkNet(STATE_PORT) < 0
    WaitNet #STATE_PORT, 1
    OpenAgain STATE_PORT, STATE_FRAME_TIMER
  Loop
  For i = 0 To 59
    m_position(i) = 0
  Next i
  For i = 0 To 5
    m_place(i) = 150
  Next i
  PutHead ByRef m_position(), POSITION_BYTES, MSG_JOINT_POSITION, COMM_TOPIC, REPLY_INVALID
  PutHead ByRef m_status(), STATUS_BYTES, MSG_STATUS, COMM_TOPIC, REPLY_INVALID
  m_length = 0
  TmReset STATE_TIMER
  m_due = 0
  m_moving = STATE_UNKNOWN
  i = 0
  Do
    ' A status is sent after ten positions, or as soon as the arm has stopped
    i = i + 1
    If i = 11 Or (m_moving = STATE_TRUE And Moving = STATE_FALSE) Then
      SendStatus
      i = 0
    Else
      SendPosition
    EndIf
    If Not NextSlot Then Exit Function
  Loop
Fend

' Answers a received message, and waits until the next message is due. Returns False to disconnect the client.
' A Wait may take longer than requested. The following ones are then shorter, so that the average period is correct.
Function NextSlot As Boolean
  Integer taken
  Double until_due
  taken = TakeFrame(STATE_PORT, STATE_FRAME_TIMER, ByRef m_frame(), ByRef m_length)
  If taken = 1 Then
    AnswerOther STATE_PORT, ByRef m_frame(), m_length, ByRef m_answer()
    m_length = 0
  EndIf
  m_due = m_due + STATE_PERIOD
  until_due = m_due - Tmr(STATE_TIMER)
  If until_due > 0.001 Then
    Wait until_due
  ElseIf until_due < -0.03 Or m_due > 1000 Then
    Wait 0.01
    TmReset STATE_TIMER
    m_due = 0
  EndIf
  NextSlot = (taken >= 0)
Fend

Function SendPosition
  Integer j
  Boolean fits
  For j = 0 To JOINT_COUNT - 1
    fits = PackFloat((RealPls(j + 1) - g_zero(j)) * g_per_pulse(j) / g_unit(j), ByRef m_position(), 20 + 4 * j, ByRef m_place(), j)
  Next j
  WriteBin #STATE_PORT, m_position(), 60
Fend

Function Moving As Long
  Long bits
  bits = RobotInfo(0)
  Moving = STATE_FALSE
  If (bits And &H200) <> 0 And (bits And &H400) = 0 Then Moving = STATE_TRUE
  ' The arm may be at rest between two points, before main starts the next motion
  If g_head <> g_tail Then
    If Blocked = 0 And PauseOn = 0 And SafetyOn = 0 Then Moving = STATE_TRUE
  EndIf
Fend

Function SendStatus
  Long number
  Integer why, key_switch
  why = Blocked
  m_moving = Moving
  number = SysErr
  If number = 0 Then number = g_main_error
  If number = 0 Then number = g_point_error
  If number = 0 And why = NO_TASK Then number = NO_TASK
  key_switch = MODE_MANUAL
  If CtrlInfo(7) = 1 Then key_switch = MODE_AUTO
  PackLong Truth(Motor), ByRef m_status(), 16
  PackLong Truth(EStopOn), ByRef m_status(), 20
  PackLong number, ByRef m_status(), 24
  PackLong Truth(ErrorOn), ByRef m_status(), 28
  PackLong m_moving, ByRef m_status(), 32
  PackLong key_switch, ByRef m_status(), 36
  If why <> 0 Or PauseOn <> 0 Or SafetyOn <> 0 Then
    PackLong STATE_FALSE, ByRef m_status(), 40
  Else
    PackLong STATE_TRUE, ByRef m_status(), 40
  EndIf
  WriteBin #STATE_PORT, m_status(), 44
Fend

Function Truth(given As Integer) As Integer
  Truth = STATE_FALSE
  If given <> 0 Then Truth = STATE_TRUE
Fend
