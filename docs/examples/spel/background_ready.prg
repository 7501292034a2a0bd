' Does the output Ready stay on with a background task? Look at the last digit of $GetStatus.
Function BgMain
  Do
    Wait 1
  Loop
Fend
Function main
Fend
