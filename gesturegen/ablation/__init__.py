"""The ablation study (§5.2, Table 2): what it runs, its figures over seeds, their tables and plot."""
