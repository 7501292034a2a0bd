' Messages on a port: reading without waiting, and replies that are the same for all servers.
' Copyright 2026 the epson_driver developers. SPDX-License-Identifier: Apache-2.0

#include "config.inc"
#include "messages.inc"
#include "globals.inc"

' Reads a message. 1: complete, in b() without the length prefix. Set length to 0 before the next message.
' 0: incomplete. -1: the client has disconnected, its length is invalid, or the message took longer than 1 s.
Function TakeFrame(port As Integer, timer As Integer, ByRef b() As Integer, ByRef length As Long) As Integer
  Long given
  Integer there
  TakeFrame = 0
  there = ChkNet(port)
  If length = 0 And there >= LENGTH_BYTES Then
    ReadBin #port, b(), LENGTH_BYTES
    given = UnpackLong(ByRef b(), 0)
    If given < HEAD_BYTES Or given > LONGEST_FRAME Then
      TakeFrame = -1
      Exit Function
    EndIf
    length = given
    TmReset timer
    there = ChkNet(port)
  EndIf
  If there < 0 Then
    TakeFrame = -1
  ElseIf length > 0 Then
    If there >= length Then
      ReadBin #port, b(), length
      TakeFrame = 1
    ElseIf Tmr(timer) > 1 Then
      TakeFrame = -1
    EndIf
  EndIf
Fend

' Reopens a port that has had no client for a while. A client that has connected and disconnected between two checks is
' invisible to ChkNet, and could block the next client.
Function OpenAgain(port As Integer, timer As Integer)
  If Tmr(timer) > NOBODY_FOR And ChkNet(port) < 0 Then
    CloseNet #port
    OpenNet #port As Server
    TmReset timer
  EndIf
Fend

' Writes the length prefix and the header of a message.
Function PutHead(ByRef message() As Integer, length As Long, kind As Long, comm As Integer, code As Integer)
  PackLong length, ByRef message(), 0
  PackLong kind, ByRef message(), 4
  PackLong comm, ByRef message(), 8
  PackLong code, ByRef message(), 12
Fend

' Returns whether the header in b() is valid: type above 0, and a reply code in replies only
Function GoodHead(ByRef b() As Integer) As Boolean
  Long comm, code
  comm = UnpackLong(ByRef b(), 4)
  code = UnpackLong(ByRef b(), 8)
  GoodHead = False
  If UnpackLong(ByRef b(), 0) > 0 Then
    If comm = COMM_TOPIC Or comm = COMM_SERVICE_REQUEST Then
      If code = REPLY_INVALID Then GoodHead = True
    ElseIf comm = COMM_SERVICE_REPLY Then
      If code = REPLY_SUCCESS Or code = REPLY_FAILURE Then GoodHead = True
    EndIf
  EndIf
Fend

' Answers PING and GET_VERSION, and any other request with FAILURE.
Function AnswerOther(port As Integer, ByRef b() As Integer, length As Long, ByRef message() As Integer)
  Long kind
  Integer i, size
  kind = UnpackLong(ByRef b(), 0)
  If kind <= 0 Then Exit Function
  If GoodHead(ByRef b()) Then
    If UnpackLong(ByRef b(), 4) <> COMM_SERVICE_REQUEST Then Exit Function
    size = length - HEAD_BYTES
    If kind = MSG_PING And size Mod 4 = 0 Then
      If size <> 40 Then size = 0
      PutHead ByRef message(), HEAD_BYTES + size, MSG_PING, COMM_SERVICE_REPLY, REPLY_SUCCESS
      For i = 16 To 15 + size
        message(i) = 0
      Next i
      WriteBin #port, message(), LENGTH_BYTES + HEAD_BYTES + size
      Exit Function
    ElseIf kind = MSG_GET_VERSION And size = 0 Then
      PutHead ByRef message(), 24, MSG_GET_VERSION, COMM_SERVICE_REPLY, REPLY_SUCCESS
      PackLong 0, ByRef message(), 16
      PackLong 2, ByRef message(), 20
      PackLong 0, ByRef message(), 24
      WriteBin #port, message(), 28
      Exit Function
    EndIf
  EndIf
  PutHead ByRef message(), HEAD_BYTES, kind, COMM_SERVICE_REPLY, REPLY_FAILURE
  WriteBin #port, message(), 16
Fend
