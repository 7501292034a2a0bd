' What do a second client, FIN and a reset look like? Connect twice with nc, end one, kill the other.
Function main
  SetNet #201, "192.168.0.2", 11002, CRLF, NONE, 0
  OpenNet #201 As Server
  Do
    Print ChkNet(201)
    Wait 1
  Loop
Fend
