//! Lamps, visibility and shading: the scene under a new light.
