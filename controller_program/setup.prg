' Tables that are filled once, and functions that both the servers and main use.
' Copyright 2026 the epson_driver developers. SPDX-License-Identifier: Apache-2.0

#include "config.inc"
#include "messages.inc"
#include "globals.inc"

' Fills the tables. It is called once, before any other function
Function SetUp
  Integer j
  BytesInit
  For j = 0 To 5
    g_unit(j) = 57.29577951308232
  Next j
#ifdef SCARA
  g_unit(2) = 1000
#endif
  g_most(0) = J1_SPEED
  g_most(1) = J2_SPEED
  g_most(2) = J3_SPEED
  g_most(3) = J4_SPEED
  g_most(4) = J5_SPEED
  g_most(5) = J6_SPEED
  Calibrate
  g_ready = 1
Fend

' Computes degrees per pulse from two angles of each joint, without a motion: first from 30 degrees to each side, then
' from 90 % of its range, because the rounding to whole pulses matters less over a longer distance.
Function Calibrate
  Integer j
  Double one, two
  For j = 0 To JOINT_COUNT - 1
#ifdef SCARA
    If j = 2 Then
      Measure j, -30, -10
    Else
      Measure j, -30, 30
    EndIf
#else
    Measure j, -30, 30
#endif
  Next j
  ReadLimits
  For j = 0 To JOINT_COUNT - 1
    one = g_lowest(j) * 0.9
    two = g_highest(j) * 0.9
    If one < -150 Then one = -150
    If two > 150 Then two = 150
    Measure j, one, two
  Next j
Fend

' Joint 5 is at 30 degrees in both poses. At 0 the controller could use joint 6 instead of joint 4.
Function Measure(j As Integer, one As Double, two As Double)
  Integer i
  Double a(5)
  Long at_one, at_two
  For i = 0 To 5
    a(i) = 0
  Next i
  a(4) = 30
  a(j) = one
#ifdef SCARA
  at_one = PPls(AglToPls(a(0), a(1), a(2), a(3)), j + 1)
  a(j) = two
  at_two = PPls(AglToPls(a(0), a(1), a(2), a(3)), j + 1)
#else
  at_one = PPls(AglToPls(a(0), a(1), a(2), a(3), a(4), a(5)), j + 1)
  a(j) = two
  at_two = PPls(AglToPls(a(0), a(1), a(2), a(3), a(4), a(5)), j + 1)
#endif
  g_per_pulse(j) = (two - one) / (at_two - at_one)
  g_zero(j) = at_one - one / g_per_pulse(j)
  ' the zero position is a whole pulse
  g_zero(j) = Int(g_zero(j) + 0.5)
Fend

' Reads the joint limits, in degrees, and reduces them by three pulses at each end
Function ReadLimits
  Integer j
  Double one, two, margin
  For j = 0 To JOINT_COUNT - 1
    one = (JRange(j + 1, 1) - g_zero(j)) * g_per_pulse(j)
    two = (JRange(j + 1, 2) - g_zero(j)) * g_per_pulse(j)
    margin = 3 * Abs(g_per_pulse(j))
    If one > two Then
      g_highest(j) = one - margin
      g_lowest(j) = two + margin
    Else
      g_highest(j) = two - margin
      g_lowest(j) = one + margin
    EndIf
  Next j
Fend

' Returns the number after n in a ring of 256
Function Following(n As Integer) As Integer
  Following = (n + 1) And 255
Fend

' Returns the error number of the reason why points are refused now, or 0
Function Blocked As Integer
  Integer state
  Blocked = 0
  If Motor = Off Then Blocked = MOTORS_OFF
#ifdef AUTO_ONLY
  If CtrlInfo(7) = 0 Then Blocked = MOTORS_OFF
#endif
  state = TaskState(main)
  If state = 0 Or state = 5 Then Blocked = NO_TASK
#ifdef DOOR_ENDS_MOTION
  If SafetyOn <> 0 Then Blocked = NO_TASK
#endif
  If EStopOn <> 0 Or ErrorOn <> 0 Then Blocked = NO_TASK
Fend
