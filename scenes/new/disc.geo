// A disc, drawn in metres. Gmsh makes disc.msh of it:
//
//   gmsh -2 disc.geo
SetFactory("OpenCASCADE");
radius = 0.2;
Disk(1) = {0, 0, 0, radius};

// A round hole in the middle: remove the slashes.
// Disk(2) = {0, 0, 0, 0.05};
// BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };

// Scenes refer to edges and surfaces by these names.
Physical Curve("rim") = Curve In BoundingBox{-1.1*radius, -1.1*radius, -1, 1.1*radius, 1.1*radius, 1};
Physical Surface("sheet") = Surface{:};

Mesh.MeshSizeMax = radius/6;
