// Number of a static mesh, the same for all its tiles, or of a shape that moves. Needs the object's data.
int surfaceNumber() {
  int mesh = objectDataBuffer.staticMesh;
  return mesh > 0 ? 2 * mesh + 1 : 2 * int(objectDataBuffer.segmentation.x);
}
