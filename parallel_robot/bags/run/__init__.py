"""The run of a bag: states, references and commands as time-aligned arrays."""
