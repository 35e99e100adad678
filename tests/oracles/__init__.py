"""What the tests compare with: solutions found another way than in the code under test."""
