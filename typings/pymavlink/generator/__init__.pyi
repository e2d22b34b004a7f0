# See mavgen.pyi and mavparse.pyi.
