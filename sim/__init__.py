"""JSBSim fixed-wing software-in-the-loop simulator that stands in for the aircraft."""
