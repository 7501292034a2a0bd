' Does PPls(AglToPls(...)) work in a background task before anything has moved? It must print pulses.
Function BgMain
  Print PPls(AglToPls(10, 20, 30, 40, 50, 60), 4)
  Print JRange(1, 1), RealPls(1)
Fend
Function main
Fend
