"""Files: saved results, chaos files, fields for ParaView."""
