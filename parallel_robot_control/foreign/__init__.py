"""Laws that are neither Python nor of the suite: C functions and FMUs, each in a process."""
