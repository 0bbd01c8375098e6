// A bracket of sheet metal with a round hole, drawn in millimetres. Gmsh makes bracket.msh of it:
//
//   gmsh -2 bracket.geo
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 160, 80};
Disk(2) = {110, 40, 0, 15};
BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };

// Scenes refer to edges, points and surfaces by these names.
Physical Curve("wall") = Curve In BoundingBox{-1, -1, -1, 1, 81, 1};
Physical Point("corner") = Point In BoundingBox{159, -1, -1, 161, 1, 1};
Physical Surface("sheet") = {3};

// Cells of at most 12 mm, and 24 of their edges around a circle.
Mesh.MeshSizeMax = 12;
Mesh.MeshSizeFromCurvature = 24;
