from .selection import (
    Candidates as Candidates,
    QuestionConfig as QuestionConfig,
    find_candidates as find_candidates,
    generate_questions as generate_questions,
    select_questions as select_questions,
)
