"""The gesture motion graph: key nodes, natural and unnatural edges (§4.1)."""
