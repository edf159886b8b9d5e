"""Episodes side by side: a `Carry` says where they are, `unroll` plays them, `replay` asks about recorded."""
