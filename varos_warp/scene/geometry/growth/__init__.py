"""What grows and lies on surfaces: prototypes by kind, and where chance puts their copies (docs/growth.md)."""
