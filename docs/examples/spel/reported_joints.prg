' Do Agl and RealPls lag during a motion?
Function main
  Xqt 2, watcher
  Motor On
  Go AglToPls(30, 0, 0, 0, 30, 0)
  Go AglToPls(0, 0, 0, 0, 30, 0)
  Quit watcher
Fend
Function watcher
  Do
    Print Tmr(0), Agl(1), RealPls(1), Pls(1)
    Wait 0.05
  Loop
Fend
