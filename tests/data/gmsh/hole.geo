// The plate of CSMA 2013 with a hole: triangles, a curved boundary, a named point.
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1.2, 0.4};
Disk(2) = {0.8, 0.2, 0, 0.08};
BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
e = 1e-6;
left() = Curve In BoundingBox{-e, -e, -e, e, 0.4 + e, e};
corner() = Point In BoundingBox{1.2 - e, -e, -e, 1.2 + e, e, e};
hole() = Curve In BoundingBox{0.7, 0.1, -e, 0.9, 0.3, e};
Physical Curve("left") = left();
Physical Curve("edge of the hole") = hole();
Physical Point("corner") = corner();
Physical Surface("plate") = {3};
Mesh.MeshSizeMin = 0.08;
Mesh.MeshSizeMax = 0.08;
