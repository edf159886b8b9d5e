"""Episodes side by side: a `World`, `Lanes` with a policy, and the `Run` that plays them."""
