' The motion server: receives points, checks them, computes Speed and Accel, and stores the points for main.
' It does not move the arm.
' Copyright 2026 the epson_driver developers. SPDX-License-Identifier: Apache-2.0

#include "config.inc"
#include "messages.inc"
#include "globals.inc"

' Maximum number of points in the ring
#define RING_FULL 250
' Tolerance for limits that a client has rounded to binary32, degrees or mm
#define ROUNDED 0.001

' The received message, and the reply
Integer m_frame(1023), m_out(63)
Long m_length
' Whether a client is connected
Boolean m_client
' Whether the client sends heartbeats, and whether it has been silent for too long since its last STOP
Boolean m_beats, m_hung

' Points in the ring from g_head up to m_in are received, but not passed to main. Points up to m_ready may be passed.
Integer m_in, m_ready
' For each point: its sequence, whether it has not been answered yet, velocity (0 to 1) and duration (s)
Long m_sequence(255)
Integer m_owed(255)
Double m_velocity(255), m_duration(255)

' Allowed sequence of the next point, in addition to 0 (-1: only 0)
Long m_expected
' 0: streaming. 1: a download is being received. 2: the remaining points of a download are refused.
Integer m_loading
' Whether the client downloads with topics, which are not answered
Boolean m_topics
' Number of received points of the download
Integer m_loaded

' The joint angles of the last point, if known, and of the received point
Boolean m_known
Double m_last(5), m_target(5)
' Delay of the arm behind the plan caused by the rounding of Speed, seconds
Double m_late

' Previous values of g_starts and g_faults, and previous result of Blocked
Integer m_starts, m_faults, m_blocked

' A background task that never ends
Function MotionServer
  OnErr GoTo motion_error
  Do
    MotionService
    m_client = False
    g_lost = Following(g_lost)
    DropPoints
    Wait 0.1
  Loop
motion_error:
  EResume Next
Fend

' Serves one client
Function MotionService
  Integer i, taken
  OnErr GoTo motion_failed
  If ChkNet(MOTION_PORT) <> -3 Then CloseNet #MOTION_PORT
  SetNet #MOTION_PORT, OWN_ADDRESS, MOTION_TCP_PORT, CRLF, NONE, 2
  OpenNet #MOTION_PORT As Server
  TmReset MOTION_TIMER
  Do While ChkNet(MOTION_PORT) < 0
    WaitNet #MOTION_PORT, 0.05
    Watch
    OpenAgain MOTION_PORT, MOTION_TIMER
  Loop
  ReadLimits
  m_length = 0
  m_client = True
  m_beats = False
  m_hung = False
  Do
    For i = 1 To 4
      Watch
      taken = TakeFrame(MOTION_PORT, MOTION_TIMER, ByRef m_frame(), ByRef m_length)
      If taken < 0 Then Exit Function
      If taken = 0 Then Exit For
      TmReset CLIENT_TIMER
      TakeMessage
      m_length = 0
    Next i
    WatchClient
    Plan
    Wait 0.01
  Loop
motion_failed:
  EResume motion_end
motion_end:
Fend

' Drops all points when main has started or failed, and when motion is no longer allowed.
Function Watch
  Integer why
  why = Blocked
  If g_starts <> m_starts Or g_faults <> m_faults Then
    m_starts = g_starts
    m_faults = g_faults
    DropPoints
  ElseIf why <> 0 And m_blocked = 0 Then
    DropPoints
  EndIf
  m_blocked = why
Fend

' Drops all points of a client that is silent for too long. A failed PING informs the client. Its points are refused
' until it sends a STOP. Points that were dropped stay in the ring until main confirms this, and are then ignored.
Function WatchClient
  If m_beats And Not m_hung And g_tail <> m_in And g_seen = g_epoch Then
    If Tmr(CLIENT_TIMER) > CLIENT_TIMEOUT Then
      m_hung = True
      g_point_error = CLIENT_SILENT
      PutHead ByRef m_out(), HEAD_BYTES, MSG_PING, COMM_SERVICE_REPLY, REPLY_FAILURE
      WriteBin #MOTION_PORT, m_out(), 16
      DropPoints
    EndIf
  EndIf
Fend

' Stops the arm, drops all points, and answers pending points with FAILURE. The next point must have sequence 0.
' The bit is set before g_epoch is incremented: see Settle in main.prg
Function DropPoints
  Integer i
  MemOn STOP_BIT
  g_epoch = Following(g_epoch)
  m_expected = -1
  m_known = False
  m_loading = 0
  i = g_head
  Do While i <> m_in
    If m_client And m_owed(i) <> 0 Then
      m_owed(i) = 0
      AnswerPoint m_sequence(i), REPLY_FAILURE
    EndIf
    i = Following(i)
  Loop
  m_in = g_head
  m_ready = g_head
Fend

Function AnswerPoint(sequence As Long, code As Integer)
  Integer i
  PutHead ByRef m_out(), POSITION_BYTES, MSG_JOINT_POSITION, COMM_SERVICE_REPLY, code
  PackLong sequence, ByRef m_out(), 16
  For i = 20 To 59
    m_out(i) = 0
  Next i
  WriteBin #MOTION_PORT, m_out(), 60
Fend

Function TakeMessage
  If UnpackLong(ByRef m_frame(), 0) <> MSG_JOINT_TRAJ_PT Then
    If UnpackLong(ByRef m_frame(), 0) = MSG_PING And UnpackLong(ByRef m_frame(), 4) = COMM_TOPIC Then m_beats = True
    AnswerOther MOTION_PORT, ByRef m_frame(), m_length, ByRef m_out()
  ElseIf Not GoodHead(ByRef m_frame()) Or m_length <> POINT_BYTES Then
    Refuse 0, CORRUPT_MSG, True
  ElseIf UnpackLong(ByRef m_frame(), 4) <> COMM_SERVICE_REPLY Then
    TakePoint
  EndIf
Fend

' Ends the motion, and answers a point with FAILURE.
Function Refuse(sequence As Long, number As Integer, answered As Boolean)
  g_point_error = number
  DropPoints
  If answered Then AnswerPoint sequence, REPLY_FAILURE
Fend

Function TakePoint
  Long sequence
  Boolean asked
  Integer number
  sequence = UnpackLong(ByRef m_frame(), HEAD_BYTES)
  asked = (UnpackLong(ByRef m_frame(), 4) = COMM_SERVICE_REQUEST)
  If sequence = SEQ_STOP_TRAJECTORY Then
    DropPoints
    m_hung = False
    If asked Then AnswerPoint sequence, REPLY_SUCCESS
    Exit Function
  EndIf
  number = Blocked
  If m_hung Then number = CLIENT_SILENT
  If number = 0 Then number = CheckSequence(sequence, asked)
  If number = 0 Then number = CheckNumbers
  If number = 0 And ((m_in - g_tail) And 255) >= RING_FULL Then number = CORRUPT_MSG
  If m_loading = 2 Then
    If sequence = SEQ_END_TRAJECTORY Then m_loading = 0
    If asked Then AnswerPoint sequence, REPLY_FAILURE
  ElseIf number <> 0 Then
    asked = asked And Not (m_loading = 1 And m_topics)
    number = RefuseOf(sequence, number, asked)
  Else
    AddPoint sequence, asked
  EndIf
Fend

' Refuses a point. If it belongs to a download, its remaining points are refused, too.
Function RefuseOf(sequence As Long, number As Integer, asked As Boolean) As Integer
  Integer loading
  loading = m_loading
  Refuse sequence, number, asked
  If loading = 1 And sequence <> SEQ_END_TRAJECTORY Then m_loading = 2
  RefuseOf = number
Fend

' Checks the sequence of a point, and starts downloads. Returns 0 or an error number.
Function CheckSequence(sequence As Long, asked As Boolean) As Integer
  CheckSequence = CORRUPT_MSG
  If sequence = SEQ_START_DOWNLOAD Then
    m_loading = 1
    m_topics = Not asked
    m_loaded = 0
    CheckSequence = 0
  ElseIf m_loading = 1 Then
    If sequence = SEQ_END_TRAJECTORY Or sequence = m_loaded Then CheckSequence = 0
  ElseIf m_loading = 2 Then
    CheckSequence = 0
    If sequence = 0 And asked Then
      m_loading = 0
    EndIf
  ElseIf asked And sequence >= 0 Then
    If sequence = 0 Or sequence = m_expected Then CheckSequence = 0
  ElseIf asked And sequence = SEQ_START_STREAMING Then
    CheckSequence = 0
  EndIf
Fend

' Checks the numbers of a point, also of unused joints, and sets m_target() in degrees. Returns 0 or an error number.
Function CheckNumbers As Integer
  Integer j
  Double x
  CheckNumbers = CORRUPT_MSG
  For j = 0 To JOINT_PLACES + 1
    If Not UnpackFloat(ByRef m_frame(), 16 + 4 * j, ByRef x) Then Exit Function
    If j < JOINT_COUNT Then m_target(j) = x * g_unit(j)
    If j = JOINT_PLACES Then
      If x < 0 Or x > 1 Then Exit Function
      m_velocity(m_in) = x
    ElseIf j > JOINT_PLACES Then
      If x < 0 Or x > 86400 Then Exit Function
      m_duration(m_in) = x
    EndIf
  Next j
  CheckNumbers = OUT_OF_RANGE
  For j = 0 To JOINT_COUNT - 1
    If m_target(j) < g_lowest(j) - ROUNDED Or m_target(j) > g_highest(j) + ROUNDED Then Exit Function
    If m_target(j) < g_lowest(j) Then m_target(j) = g_lowest(j)
    If m_target(j) > g_highest(j) Then m_target(j) = g_highest(j)
  Next j
  CheckNumbers = 0
Fend

' Adds a valid point to the ring.
Function AddPoint(sequence As Long, asked As Boolean)
  Integer j
  For j = 0 To 5
    g_q(6 * m_in + j) = m_target(j)
  Next j
  g_point_error = 0
  m_sequence(m_in) = sequence
  m_owed(m_in) = 0
  If m_loading = 0 Then m_owed(m_in) = 1
  m_in = Following(m_in)
  If m_loading = 1 Then
    m_loaded = m_loaded + 1
    m_expected = -1
    If sequence = SEQ_END_TRAJECTORY Then
      m_loading = 0
      m_ready = m_in
    EndIf
    If asked Then AnswerPoint sequence, REPLY_SUCCESS
  Else
    m_expected = 1
    If sequence > 0 Then m_expected = sequence + 1
    m_ready = m_in
  EndIf
Fend

' Passes up to LOOK_AHEAD points to main and answers them. A fast client waits for these answers.
' After DropPoints, it waits until main confirms that the arm is at rest. The distance to the next point is then known.
Function Plan
  Do While g_head <> m_ready And g_seen = g_epoch And ((g_head - g_tail) And 255) < LOOK_AHEAD
    PlanPoint g_head
    If m_owed(g_head) <> 0 Then
      m_owed(g_head) = 0
      g_head = Following(g_head)
      AnswerPoint m_sequence((g_head - 1) And 255), REPLY_SUCCESS
    Else
      g_head = Following(g_head)
    EndIf
  Loop
Fend

' Computes Speed and Accel of point n as whole percents. The next point compensates the delay caused by rounding.
Function PlanPoint(n As Integer)
  Integer j, most
  Double way, share, seconds, percent
  If Not m_known Or g_head = g_tail Then
    If Not m_known Then
      For j = 0 To JOINT_COUNT - 1
        m_last(j) = Agl(j + 1)
      Next j
    EndIf
    m_late = 0
  EndIf
  m_known = True
  ' way: duration of the motion at full speed, seconds
  way = 0
  For j = 0 To JOINT_COUNT - 1
    share = Abs(g_q(6 * n + j) - m_last(j)) / g_most(j)
    If share > way Then way = share
    m_last(j) = g_q(6 * n + j)
  Next j
  most = MOST_SPEED
  If m_velocity(n) > 0 And m_velocity(n) < 1 Then most = Int(m_velocity(n) * MOST_SPEED)
  ' round up, because a lower percentage would delay every point of a stream
  If most < MOST_SPEED And m_duration(n) > 0 Then most = Int(m_velocity(n) * MOST_SPEED + 0.999)
  If most < 1 Then most = 1
  g_dwell(n) = 0
  percent = most
  If way < 0.000001 Then
    g_dwell(n) = m_duration(n)
  ElseIf m_duration(n) > 0 Then
    seconds = m_duration(n) - OVERHEAD_MS / 1000
    If seconds < m_duration(n) / 2 Then seconds = m_duration(n) / 2
    ' even if the arm is late, at most the requested speed rounded up to a whole percent
    percent = Int(way / seconds * 100) + 1
    If way < (seconds - m_late) * percent / 100 Then percent = Int(way / (seconds - m_late) * 100)
    If percent > most Then percent = most
    If percent < 1 Then percent = 1
    m_late = m_late + way / percent * 100 + OVERHEAD_MS / 1000 - m_duration(n)
    If m_late > 0.5 Then m_late = 0.5
    If m_late < -0.5 Then m_late = -0.5
  EndIf
  g_speed(n) = Int(percent)
  ' an acceleration takes BLEND_MS, or the whole segment if that is shorter
  seconds = way / percent * 100000
  If seconds > BLEND_MS Then seconds = BLEND_MS
  seconds = seconds - RAMP_MS
  If seconds < 1 Then seconds = 1
  percent = Int(percent * T100_MS / seconds)
  If percent < 1 Then percent = 1
  If percent > 100 Then percent = 100
  g_accel(n) = Int(percent)
Fend
