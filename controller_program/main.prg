' main moves the arm. No other task moves it. BgMain starts the servers.
' Copyright 2026 the epson_driver developers. SPDX-License-Identifier: Apache-2.0

#include "config.inc"
#include "messages.inc"
#include "globals.inc"

' Previous value of g_lost
Integer m_lost
' Whether the motors have been off since main ended
Boolean m_motors_off

#ifndef NO_BACKGROUND
' The background task that starts with the controller
Function BgMain
  OnErr GoTo background_error
  SetUp
  Do
    KeepRunning
    Wait 0.1
  Loop
background_error:
  EResume Next
Fend

Function KeepRunning
  OnErr GoTo keep_failed
  If TaskState(MotionServer) = 0 Then Xqt 66, MotionServer
  If TaskState(StateServer) = 0 Then Xqt 67, StateServer
  If TaskState(IoServer) = 0 Then Xqt 68, IoServer
#ifdef DOOR_ENDS_MOTION
  If SafetyOn <> 0 And TaskState(main) <> 0 Then Quit main
#endif
#ifdef START_MAIN
  If Motor = Off Then
    m_motors_off = True
  ElseIf m_motors_off And TaskState(main) = 0 And EStopOn = 0 And ErrorOn = 0 And SafetyOn = 0 And PauseOn = 0 Then
    m_motors_off = False
    StartMain main
  EndIf
#endif
  Exit Function
keep_failed:
  EResume keep_end
keep_end:
Fend
#endif

Function main
  Integer before
#ifdef NO_BACKGROUND
  If g_ready = 0 Then SetUp
  If TaskState(MotionServer) = 0 Then Xqt 2, MotionServer, NoEmgAbort
  If TaskState(StateServer) = 0 Then Xqt 3, StateServer, NoEmgAbort
  If TaskState(IoServer) = 0 Then Xqt 4, IoServer, NoEmgAbort
#endif
  Wait g_ready <> 0, 5
  If TW <> 0 Then Error NOT_READY
#ifndef FULL_POWER
  Print "Low power, slower than planned: FULL_POWER is off in config.inc"
#endif
  m_lost = g_lost
  g_main_error = 0
  before = g_epoch
  g_starts = Following(g_starts)
  Do
    ' MotionServer detects that main has started or failed, and then drops all points
    Wait g_epoch <> before
    MoveAll
    before = g_epoch
    g_faults = Following(g_faults)
    Wait 0.1
  Loop
Fend

' Moves from point to point until an error occurs
Function MoveAll
  OnErr GoTo move_failed
  Till MemSw(STOP_BIT) = On
  Settle
  Do
    Wait g_head <> g_tail Or g_epoch <> g_seen, 0.5
    If g_epoch <> g_seen Then
      Settle
    ElseIf g_head <> g_tail Then
      StartWait
      MoveChain
    EndIf
  Loop
move_failed:
  g_main_error = Err
  EResume move_end
move_end:
Fend

' Waits until the arm is at rest, drops all points, and confirms this to MotionServer (g_seen).
' MotionServer sets the bit before it increments g_epoch. This function clears the bit before it reads g_epoch. An
' increment in between is therefore either read here, or detected by the next comparison with g_seen.
Function Settle
  Integer seen
  MemOff STOP_BIT
  seen = g_epoch
  If Motor = On Then WaitPos
#ifdef LOST_CLIENT_MOTORS_OFF
  If g_lost <> m_lost Then
    m_lost = g_lost
    If Motor = On Then Motor Off
  EndIf
#endif
  g_tail = g_head
  g_seen = seen
Fend

' Waits for START_POINTS points before an arm at rest moves, so that it does not stop at the first point.
Function StartWait
  Integer seen
#ifdef FULL_POWER
  If Power = Low Then Power High
#endif
  seen = g_head
  TmReset START_TIMER
  Do While ((g_head - g_tail) And 255) < START_POINTS And g_epoch = g_seen And Tmr(START_TIMER) < START_WAIT And InPos <> 0
    Wait 0.01
    If g_head <> seen Then
      seen = g_head
      TmReset START_TIMER
    EndIf
  Loop
Fend

' Moves to the points in the ring until it is empty
Function MoveChain
  Do While g_head <> g_tail And g_epoch = g_seen
    If g_dwell(g_tail) > 0 Then
      WaitPos
      Wait g_epoch <> g_seen, g_dwell(g_tail)
    Else
      Speed g_speed(g_tail)
      Accel g_accel(g_tail), g_accel(g_tail)
      ' The arm comes to rest at this point, unless the next one arrives before the deceleration
#ifdef SCARA
      Go AglToPls(g_q(6 * g_tail), g_q(6 * g_tail + 1), g_q(6 * g_tail + 2), g_q(6 * g_tail + 3)) CP Till
#else
      Go AglToPls(g_q(6 * g_tail), g_q(6 * g_tail + 1), g_q(6 * g_tail + 2), g_q(6 * g_tail + 3), g_q(6 * g_tail + 4), g_q(6 * g_tail + 5)) CP Till
#endif
      If MemSw(STOP_BIT) = On Then
        Wait g_epoch <> g_seen, 0.1
        If g_epoch = g_seen Then Error STOPPED_BY_BIT
      EndIf
    EndIf
    g_tail = (g_tail + 1) And 255
  Loop
Fend
