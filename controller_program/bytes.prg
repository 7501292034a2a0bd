' Converts numbers to bytes and back, least significant byte first, without a DLL.
' Copyright 2026 the epson_driver developers. SPDX-License-Identifier: Apache-2.0
'
' SPEL+ has no access to the bits of a Real, so binary32 values are composed and decomposed by arithmetic.
' Multiplying a Double by a power of two is exact. The only rounding (halves to even) is done here.
' A byte is an Integer from 0 to 255, as in ReadBin and WriteBin.

#include "globals.inc"

' g_pow2(i) is 2 ** (i - 150), for all powers of two that binary32 needs
#define POW2_ONE 150
#define POW2_LAST 303
' Indices in g_pow2 of 2 ** -126 (the smallest normal number) and of 2 ** 128 (above the largest number)
#define POW2_NORMAL 24
#define POW2_OVER 278
' Indices of 2 ** -149 (the smallest number) and of 2 ** 149
#define POW2_SMALLEST 1
#define POW2_TO_WHOLE 299
' 2 ** 23, and 2 ** 24
#define HIDDEN_BIT 8388608
#define TWO_HIDDEN_BITS 16777216

' Fills the table. It is called once, before any other function in this file
Function BytesInit
  Integer i
  g_pow2(POW2_ONE) = 1
  For i = POW2_ONE + 1 To POW2_LAST
    g_pow2(i) = g_pow2(i - 1) * 2
  Next i
  For i = POW2_ONE - 1 To 0 Step -1
    g_pow2(i) = g_pow2(i + 1) / 2
  Next i
Fend

' Writes x as binary32 to the four bytes from b(pos). Returns False, and writes nothing, if x is too large.
' place(slot) stores the index of the largest power of two up to x, because the next number of the same slot usually
' has the same one. Initialize it with 150.
Function PackFloat(x As Double, ByRef b() As Integer, pos As Integer, ByRef place() As Integer, slot As Integer) As Boolean
  Double m
  Integer low_place, high_place, half, sign, field
  Long n
  PackFloat = False
  m = x
  sign = 0
  If x < 0 Then
    m = -x
    sign = 128
  EndIf
  If m >= g_pow2(POW2_OVER) Then Exit Function

  If m < g_pow2(POW2_NORMAL) Then
    field = 0
    m = m * g_pow2(POW2_TO_WHOLE)
  Else
    If m < g_pow2(place(slot)) Or m >= g_pow2(place(slot) + 1) Then
      low_place = POW2_NORMAL
      high_place = POW2_OVER
      Do While high_place - low_place > 1
        half = Int((low_place + high_place) / 2)
        If m < g_pow2(half) Then
          high_place = half
        Else
          low_place = half
        EndIf
      Loop
      place(slot) = low_place
    EndIf
    field = place(slot) - 23
    m = m * g_pow2(323 - place(slot))
  EndIf

  n = Int(m)
  m = m - n
  If m > 0.5 Then
    n = n + 1
  ElseIf m = 0.5 Then
    n = n + (n And 1)
  EndIf
  If n = TWO_HIDDEN_BITS Then
    n = HIDDEN_BIT
    field = field + 1
  ElseIf n = HIDDEN_BIT And field = 0 Then
    field = 1
  EndIf
  If field = 255 Then Exit Function

  b(pos) = n And 255
  b(pos + 1) = RShift(n, 8) And 255
  b(pos + 2) = (RShift(n, 16) And 127) + (field And 1) * 128
  b(pos + 3) = sign + RShift(field, 1)
  PackFloat = True
Fend

' Reads a binary32 from the four bytes from b(pos). Returns False, and keeps x, if it is infinite or NaN.
Function UnpackFloat(ByRef b() As Integer, pos As Integer, ByRef x As Double) As Boolean
  Integer field
  Long n
  UnpackFloat = False
  field = (b(pos + 3) And 127) * 2 + RShift(b(pos + 2), 7)
  If field = 255 Then Exit Function
  n = b(pos + 2) And 127
  n = n * 256 + b(pos + 1)
  n = n * 256 + b(pos)
  If field = 0 Then
    x = n * g_pow2(POW2_SMALLEST)
  Else
    x = (n + HIDDEN_BIT) * g_pow2(field)
  EndIf
  If b(pos + 3) > 127 Then x = -x
  UnpackFloat = True
Fend

' Writes a Long to the four bytes from b(pos).
Function PackLong(n As Long, ByRef b() As Integer, pos As Integer)
  b(pos) = n And 255
  b(pos + 1) = RShift(n, 8) And 255
  b(pos + 2) = RShift(n, 16) And 255
  b(pos + 3) = RShift(n, 24) And 255
Fend

' Reads a Long from the four bytes from b(pos). The first step has the sign, so no step exceeds the range of a Long.
Function UnpackLong(ByRef b() As Integer, pos As Integer) As Long
  Long n
  n = b(pos + 3)
  If n > 127 Then n = n - 256
  n = n * 256 + b(pos + 2)
  n = n * 256 + b(pos + 1)
  UnpackLong = n * 256 + b(pos)
Fend
