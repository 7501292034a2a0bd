' How often is Till evaluated, and how does it brake? The second number: degrees after the bit was set.
Function main
  Xqt 2, setter, NoEmgAbort
  Motor On
  Till MemSw(500) = On
  MemOff 500
  Speed 5
  Accel 5, 5
  Go AglToPls(60, 0, 0, 0, 30, 0) Till
  WaitPos
  Print "rests at ", Agl(1), Tmr(0)
Fend
Function setter
  Wait 2
  TmReset 0
  MemOn 500
  Print "set at ", Agl(1)
Fend
