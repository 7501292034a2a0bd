' Does error 2556 occur in a loop that only queries a port?
Function main
  Integer n
  SetNet #201, "192.168.0.2", 11002, CRLF, NONE, 0
  OpenNet #201 As Server
  Do
    n = ChkNet(201)
  Loop While n > -5
Fend
