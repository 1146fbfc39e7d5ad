"""What is true of CLEVRER's world: words, time, physical constants, shapes and the camera. Imports no other part of `nsdr`."""
