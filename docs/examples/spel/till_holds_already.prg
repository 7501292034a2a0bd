' Does a Go whose Till condition holds already move at all? It must not, and must end without an error.
Function main
  Motor On
  Go AglToPls(0, 0, 0, 0, 30, 0)
  MemOn 500
  Till MemSw(500) = On
  Go AglToPls(5, 0, 0, 0, 30, 0) Till
  Print Agl(1), TillOn
  MemOff 500
Fend
