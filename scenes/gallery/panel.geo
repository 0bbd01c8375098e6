// Perforated panel of scenes/gallery/panel.toml: 33 round holes in a triangular pattern.
//
//   gmsh -2 -format msh41 panel.geo
SetFactory("OpenCASCADE");

length = 0.48;  // m
width = 0.30;
radius = 0.018;
pitch = 0.06;

Rectangle(1) = {0, -width / 2, 0, length, width};
hole = 2;
For row In {-2:2}
  odd = row % 2 != 0;
  For column In {1:(odd ? 6 : 7)}
    Disk(hole) = {pitch * (column + (odd ? 0.5 : 0)), row * pitch * Sqrt(3) / 2, 0, radius};
    hole++;
  EndFor
EndFor
sheet() = BooleanDifference{ Surface{1}; Delete; }{ Surface{2:hole - 1}; Delete; };

left() = Curve In BoundingBox{-1e-6, -1, -1, 1e-6, 1, 1};
right() = Curve In BoundingBox{length - 1e-6, -1, -1, length + 1e-6, 1, 1};
Physical Curve("frame") = left();
Physical Curve("lip") = right();
Physical Surface("sheet") = sheet();

Mesh.MeshSizeMax = 0.0135;
Mesh.MeshSizeMin = 0.0135;
Mesh.SaveAll = 0;
