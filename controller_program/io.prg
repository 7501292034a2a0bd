' The I/O server: inputs, outputs and memory bits for one client (messages: docs/io.md of epson_driver).
' Copyright 2026 the epson_driver developers. SPDX-License-Identifier: Apache-2.0

#include "config.inc"
#include "messages.inc"
#include "globals.inc"

' Types of I/O points
#define IO_DI 1
#define IO_DO 2
#define IO_GI 5
#define IO_GO 6
#define IO_FLAG 7
' Results of an item of a request
#define IO_DONE 1
#define IO_NO_TYPE 1001
#define IO_READ_ONLY 1002
#define IO_NO_INDEX 2001
#define IO_NO_VALUE 2002
#define IO_NO_RANGE 2003
#define IO_TOO_MUCH 65001
' Index of the first group of 16 bits
#define IO_WORDS 1000
' Maximum number of ranges, and of values in all ranges, to which a client can subscribe
#define IO_RANGES 8
#define IO_VALUES 300

Integer m_frame(1023), m_out(1023), m_used
Long m_length
' Result and value of the last item
Long m_result, m_value
' Whether the client has written outputs
Boolean m_wrote
' Subscribed ranges. A count of 0 marks a free entry
Long m_kind(7), m_start(7), m_count(7)
' Published bytes of inputs, outputs and memory, and time of the publication
Integer m_bytes(63)
Double m_published

' A background task that never ends
Function IoServer
  OnErr GoTo io_error
  TmReset IO_STREAM_TIMER
  Do
    IoService
#ifdef IO_OFF_WHEN_LOST
    If m_wrote Then ResetAll IO_DO
#endif
    m_wrote = False
    Wait 0.1
  Loop
io_error:
  EResume Next
Fend

' Serves one client
Function IoService
  Integer i, taken
  OnErr GoTo io_failed
  If ChkNet(IO_PORT) <> -3 Then CloseNet #IO_PORT
  SetNet #IO_PORT, OWN_ADDRESS, IO_TCP_PORT, CRLF, NONE, 2
  OpenNet #IO_PORT As Server
  TmReset IO_TIMER
  Do While ChkNet(IO_PORT) < 0
    WaitNet #IO_PORT, 1
    OpenAgain IO_PORT, IO_TIMER
  Loop
  m_length = 0
  m_used = 0
  For i = 0 To IO_RANGES - 1
    m_count(i) = 0
  Next i
  Do
    taken = TakeFrame(IO_PORT, IO_TIMER, ByRef m_frame(), ByRef m_length)
    If taken < 0 Then Exit Function
    If taken = 1 Then
      TakeRequest
      m_length = 0
    EndIf
    Publish
    Wait 0.01
  Loop
io_failed:
  EResume io_end
io_end:
Fend

' Appends a number to the message that is being sent
Function PutNumber(n As Long)
  PackLong n, ByRef m_out(), m_used
  m_used = m_used + 4
  If m_used > 1000 Then SendRest
Fend

Function SendRest
  If m_used > 0 Then WriteBin #IO_PORT, m_out(), m_used
  m_used = 0
Fend

' Starts a message with `size` bytes after its header
Function BeginMessage(kind As Long, comm As Integer, size As Long)
  PutHead ByRef m_out(), HEAD_BYTES + size, kind, comm, REPLY_INVALID
  If comm = COMM_SERVICE_REPLY Then m_out(12) = REPLY_SUCCESS
  m_used = 16
Fend

' Returns the controller's time in ms, which wraps to 0 after 23 days
Function Stamp As Long
  If Tmr(IO_STREAM_TIMER) > 2000000 Then
    TmReset IO_STREAM_TIMER
    m_published = 0
  EndIf
  Stamp = Int(Tmr(IO_STREAM_TIMER) * 1000)
Fend

Function TakeRequest
  Long kind, items, width
  Boolean well
  kind = UnpackLong(ByRef m_frame(), 0)
  well = GoodHead(ByRef m_frame())
  If well Then well = (UnpackLong(ByRef m_frame(), 4) = COMM_SERVICE_REQUEST)
  width = 0
  Select kind
    Case MSG_IO_READ
      width = 8
    Case MSG_IO_RESET
      width = 8
    Case MSG_IO_STREAM_UNSUB
      width = 8
    Case MSG_IO_WRITE
      width = 12
    Case MSG_IO_STREAM_SUB
      width = 12
  Send
  If well And kind = MSG_IO_INFO And m_length = 16 Then
    AnswerInfo
    Exit Function
  ElseIf well And width > 0 And m_length >= 20 Then
    items = UnpackLong(ByRef m_frame(), 16)
    If items >= 0 And items < 128 Then
      If m_length = 20 + items * width Then
        AnswerItems kind, items, width
        Exit Function
      EndIf
    EndIf
  EndIf
  AnswerOther IO_PORT, ByRef m_frame(), m_length, ByRef m_out()
Fend

Function AnswerInfo
  BeginMessage MSG_IO_INFO, COMM_SERVICE_REPLY, 124
  PutNumber UnpackLong(ByRef m_frame(), 12)
  PutNumber 1
  PutNumber 7
  PutRange IO_DI, 0, 8 * IO_INPUT_BYTES, 2
  PutRange IO_DO, 0, 8 * IO_OUTPUT_BYTES, 3
  PutRange IO_GI, 0, IO_INPUT_BYTES, 2
  PutRange IO_GI, IO_WORDS, Int(IO_INPUT_BYTES / 2), 2
  PutRange IO_GO, 0, IO_OUTPUT_BYTES, 3
  PutRange IO_GO, IO_WORDS, Int(IO_OUTPUT_BYTES / 2), 3
  PutRange IO_FLAG, 0, 8 * IO_MEMORY_BYTES, 3
  SendRest
Fend

Function PutRange(kind As Long, start As Long, many As Long, can As Long)
  PutNumber kind
  PutNumber start
  PutNumber many
  PutNumber can
Fend

' Processes the items of a request in order. An invalid item does not prevent the others.
Function AnswerItems(kind As Long, items As Long, width As Long)
  Integer i, item
  Long sort, index
  If kind = MSG_IO_READ Then
    BeginMessage kind, COMM_SERVICE_REPLY, 12 + 16 * items
  ElseIf kind = MSG_IO_WRITE Then
    BeginMessage kind, COMM_SERVICE_REPLY, 12 + 12 * items
  Else
    BeginMessage kind, COMM_SERVICE_REPLY, 8 + 12 * items
  EndIf
  PutNumber UnpackLong(ByRef m_frame(), 12)
  If kind = MSG_IO_READ Or kind = MSG_IO_WRITE Then PutNumber Stamp
  PutNumber items
  item = 20
  For i = 1 To items
    sort = UnpackLong(ByRef m_frame(), item)
    index = UnpackLong(ByRef m_frame(), item + 4)
    If kind = MSG_IO_READ Then
      ReadPoint sort, index
    ElseIf kind = MSG_IO_WRITE Then
      WritePoint sort, index, UnpackLong(ByRef m_frame(), item + 8)
    ElseIf kind = MSG_IO_RESET Then
      ResetPoint sort, index
    ElseIf kind = MSG_IO_STREAM_SUB Then
      Subscribe sort, index, UnpackLong(ByRef m_frame(), item + 8)
    Else
      Unsubscribe sort, index
    EndIf
    PutNumber sort
    PutNumber index
    PutNumber m_result
    If kind = MSG_IO_READ Then PutNumber m_value
    item = item + width
  Next i
  SendRest
Fend

' Returns the number of points of a type (words: of its groups of 16 bits), or 0 for an unknown type.
Function PointCount(sort As Long, words As Boolean) As Integer
  PointCount = 0
  Select sort
    Case IO_DI
      If Not words Then PointCount = 8 * IO_INPUT_BYTES
    Case IO_DO
      If Not words Then PointCount = 8 * IO_OUTPUT_BYTES
    Case IO_GI
      PointCount = IO_INPUT_BYTES
      If words Then PointCount = Int(IO_INPUT_BYTES / 2)
    Case IO_GO
      PointCount = IO_OUTPUT_BYTES
      If words Then PointCount = Int(IO_OUTPUT_BYTES / 2)
    Case IO_FLAG
      If Not words Then PointCount = 8 * IO_MEMORY_BYTES
  Send
Fend

' Returns IO_DONE if the points from `index` to `index` + `many` - 1 exist, else the error
Function Look(sort As Long, index As Long, many As Long) As Long
  Long first
  first = 0
  If index >= IO_WORDS Then first = IO_WORDS
  Look = IO_NO_INDEX
  If PointCount(sort, False) = 0 Then
    Look = IO_NO_TYPE
  ElseIf index >= 0 And many > 0 And many <= IO_VALUES Then
    If index - first + many <= PointCount(sort, first > 0) Then Look = IO_DONE
  EndIf
Fend

Function ReadPoint(sort As Long, index As Long)
  Integer word
  m_value = 0
  m_result = Look(sort, index, 1)
  If m_result <> IO_DONE Then Exit Function
  word = 0
  If index >= IO_WORDS Then word = index - IO_WORDS
  Select sort
    Case IO_DI
      m_value = Sw(index) And 1
    Case IO_DO
      m_value = Oport(index) And 1
    Case IO_FLAG
      m_value = MemSw(index) And 1
    Case IO_GI
      If index >= IO_WORDS Then
        m_value = InW(word) And 65535
      Else
        m_value = In(index) And 255
      EndIf
    Default
      If index >= IO_WORDS Then
        m_value = OutW(word) And 65535
      Else
        m_value = Out(index) And 255
      EndIf
  Send
Fend

Function WritePoint(sort As Long, index As Long, value As Long)
  Long most
  m_result = Look(sort, index, 1)
  If m_result <> IO_DONE Then Exit Function
  most = 1
  If sort = IO_GO Then
    most = 255
    If index >= IO_WORDS Then most = 65535
  EndIf
  If sort = IO_DI Or sort = IO_GI Or Remote(sort, index) Then
    m_result = IO_READ_ONLY
  ElseIf value < 0 Or value > most Then
    m_result = IO_NO_VALUE
  ElseIf sort = IO_FLAG Then
    If value = 1 Then
      MemOn index
    Else
      MemOff index
    EndIf
  Else
    m_wrote = True
    If most = 65535 Then
      OutW index - IO_WORDS, value, Forced
    ElseIf most = 255 Then
      Out index, value, Forced
    ElseIf value = 1 Then
      On index, Forced
    Else
      Off index, Forced
    EndIf
  EndIf
Fend

' Returns whether RC+ may use an output, or a bit of an output group, as a remote output
Function Remote(sort As Long, index As Long) As Boolean
  Long byte_index
  byte_index = IO_FIRST_OUTPUT_BYTE
  If sort = IO_DO Then byte_index = Int(index / 8)
  If sort = IO_GO Then byte_index = index
  If sort = IO_GO And index >= IO_WORDS Then byte_index = 2 * (index - IO_WORDS)
  Remote = (byte_index < IO_FIRST_OUTPUT_BYTE)
Fend

Function ResetPoint(sort As Long, index As Long)
  m_result = IO_DONE
  If index <> -1 Then
    WritePoint sort, index, 0
  ElseIf sort = -1 Then
    ResetAll IO_DO
    ResetAll IO_FLAG
  ElseIf sort = IO_DI Or sort = IO_GI Then
    m_result = IO_READ_ONLY
  ElseIf sort = IO_DO Or sort = IO_GO Or sort = IO_FLAG Then
    ResetAll sort
  Else
    m_result = IO_NO_TYPE
  EndIf
Fend

Function ResetAll(sort As Long)
  Integer i
  If sort = IO_FLAG Then
    For i = 0 To IO_MEMORY_BYTES - 1
      MemOut i, 0
    Next i
  Else
    For i = IO_FIRST_OUTPUT_BYTE To IO_OUTPUT_BYTES - 1
      Out i, 0, Forced
    Next i
  EndIf
Fend

' Subscribes to a range. It replaces a range with the same start.
Function Subscribe(sort As Long, start As Long, many As Long)
  Integer i, place
  Long total
  m_result = Look(sort, start, many)
  If m_result <> IO_DONE Then Exit Function
  place = -1
  total = many
  For i = 0 To IO_RANGES - 1
    If m_count(i) = 0 Then
      If place < 0 Then place = i
    ElseIf m_kind(i) = sort And m_start(i) = start Then
      m_count(i) = 0
      place = i
    Else
      total = total + m_count(i)
    EndIf
  Next i
  If place < 0 Or total > IO_VALUES Then
    m_result = IO_TOO_MUCH
    Exit Function
  EndIf
  m_kind(place) = sort
  m_start(place) = start
  m_count(place) = many
  ' publish at the next call of Publish
  m_published = -10
Fend

Function Unsubscribe(sort As Long, start As Long)
  Integer i
  m_result = IO_NO_RANGE
  For i = 0 To IO_RANGES - 1
    If m_count(i) > 0 And m_kind(i) = sort And m_start(i) = start Then
      m_count(i) = 0
      m_result = IO_DONE
    EndIf
  Next i
Fend

' Publishes all ranges after a change, and every IO_PERIOD without a change
Function Publish
  Integer i
  Long ranges, size, item
  Double since
  ranges = 0
  size = 8
  For i = 0 To IO_RANGES - 1
    If m_count(i) > 0 Then
      ranges = ranges + 1
      size = size + 12 + 4 * m_count(i)
    EndIf
  Next i
  since = Tmr(IO_STREAM_TIMER) - m_published
  If ranges = 0 Or since < IO_INTERVAL Then Exit Function
  If Not Changed And since < IO_PERIOD Then Exit Function
  BeginMessage MSG_IO_STREAM_PUB, COMM_TOPIC, size
  PutNumber Stamp
  m_published = Tmr(IO_STREAM_TIMER)
  PutNumber ranges
  For i = 0 To IO_RANGES - 1
    If m_count(i) > 0 Then
      PutNumber m_kind(i)
      PutNumber m_start(i)
      PutNumber m_count(i)
      For item = m_start(i) To m_start(i) + m_count(i) - 1
        ReadPoint m_kind(i), item
        PutNumber m_value
      Next item
    EndIf
  Next i
  SendRest
Fend

' Returns whether a bit has changed since the last call
Function Changed As Boolean
  Integer i, value
  Changed = False
  For i = 0 To IO_INPUT_BYTES + IO_OUTPUT_BYTES + IO_MEMORY_BYTES - 1
    If i < IO_INPUT_BYTES Then
      value = In(i) And 255
    ElseIf i < IO_INPUT_BYTES + IO_OUTPUT_BYTES Then
      value = Out(i - IO_INPUT_BYTES) And 255
    Else
      value = MemIn(i - IO_INPUT_BYTES - IO_OUTPUT_BYTES) And 255
    EndIf
    If value <> m_bytes(i) Then Changed = True
    m_bytes(i) = value
  Next i
Fend
