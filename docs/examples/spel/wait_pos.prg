' Does WaitPos wait when the motors go off? Press the E-stop, reset, and look whether main has ended.
Function main
  Motor On
  Do
    Go AglToPls(20, 0, 0, 0, 30, 0) CP
    Go AglToPls(-20, 0, 0, 0, 30, 0) CP
    WaitPos
  Loop
Fend
