' Measures T100_MS and RAMP_MS. Moves to one position at low power, and only computes times from there.
#define J1_SPEED 450
Function main
  Double quick, slow, way
  Motor On
  Go AglToPls(-80, 0, 0, 0, 30, 0)
  Power High
  way = 160 / J1_SPEED / 0.5
  Speed 50
  Accel 50, 50
  quick = PTPTime(AglToPls(80, 0, 0, 0, 30, 0), 0, 0) - way
  Accel 25, 25
  slow = PTPTime(AglToPls(80, 0, 0, 0, 30, 0), 0, 0) - way
  Print "T100_MS ", (slow - quick) * 1000, " RAMP_MS ", (2 * quick - slow) * 1000
Fend
