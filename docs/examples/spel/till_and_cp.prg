' Does Till keep the blend of CP? The two times must be the same.
Function main
  Integer i
  Motor On
  Till MemSw(500) = On
  MemOff 500
  TmReset 0
  For i = 1 To 10
    Go AglToPls(i, 0, 0, 0, 30, 0) CP
  Next i
  WaitPos
  Print "without Till ", Tmr(0)
  TmReset 0
  For i = 9 To 0 Step -1
    Go AglToPls(i, 0, 0, 0, 30, 0) CP Till
  Next i
  WaitPos
  Print "with Till ", Tmr(0)
Fend
