//! The plate at rest and in free vibration: elements, meshes, matrices.

#[path = "../common/mod.rs"]
mod common;

mod edge_moments;
mod cards;
mod elements;
mod frequencies;
mod gmsh;
mod heated;
mod inf_sup;
mod insertion;
mod linearity;
mod matrices;
mod mesh;
mod mixed_cells;
mod modes;
mod moments;
mod obstacle_plate;
mod prestress;
mod products;
mod point_masses;
mod points;
mod ribs;
mod statics;
