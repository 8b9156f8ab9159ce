"""What tests share: machines, stations, runs, counterparts. Test modules import from here, never from each other."""
