//! Eigenfrequencies of a lumped machine.
