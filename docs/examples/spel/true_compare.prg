' Does a bit that is on equal True? MemSw is 1, True is -1 (p995); programs in production wait for MemSw(0) = True.
Function main
  Integer n
  MemOn 0
  n = 1
  Print MemSw(0) = True, n = True, True ' check off: true-compare
  Wait MemSw(0) = True, 1 ' check off: true-compare
  Print TW
Fend
