' How long does a statement take, how long Wait 0.001, and how long Speed with Accel?
Function main
  Integer i, j
  TmReset 0
  For i = 1 To 10000
    j = i
  Next i
  Print "20,000 statements ", Tmr(0)
  TmReset 0
  For i = 1 To 100
    Wait 0.001
  Next i
  Print "100 Wait 0.001 ", Tmr(0)
  TmReset 0
  For i = 1 To 100
    Speed 10
    Accel 10, 10
  Next i
  Print "100 Speed and Accel ", Tmr(0)
Fend
