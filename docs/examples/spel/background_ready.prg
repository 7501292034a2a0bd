' Does a background task leave Ready on? Look at the last digit of $GetStatus.
Function BgMain
  Do
    Wait 1
  Loop
Fend
Function main
Fend
