//! A lumped machine from a drive whose links are bodies.
