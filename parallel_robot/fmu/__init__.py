"""Laws and robots as FMUs, for co-simulation: native code without Python."""
