/* The specification language.

The rules are LL(1), but for the choice between a declaration and a formula, which takes two tokens.
There is one rule for terms and formulas together, and it is flat: how strongly operators bind, and
what is a term and what a formula, is said by the table in operators.py and decided when the tree is
built (parser.py). A bracket so costs two calls, and no text makes ANTLR look ahead further.

The scanner (tokens.py) drops the END tokens that are mere white space and adds one at the end.
*/
grammar Stl;

specification
    : END* ('specification' name=NAME END+)?
      ( ( imports+=importing
        | annotations+=annotation
        | constants+=constant
        | declarations+=declaration
        | definitions+=definition
        ) END+
      )* EOF
    ;

importing : 'from' module=NAME 'import' name=NAME ;

annotation : '@' kind=NAME '(' variable=NAME ',' location=path ')' ;

// A word of the language may stand in a path.
path : '/'? step ('/' step)* ;

step
    : NAME | NUMBER | TEMPORAL | STEP | NOT | BINDING | INFIX | FUNCTION | TRUTH
    | 'inf' | 'const' | 'input' | 'output' | 'specification' | 'from' | 'import'
    ;

constant : 'const' kind=NAME name=NAME '=' default=value ;

declaration : io=('input' | 'output')? kind=NAME name=NAME ('=' default=value)? ;

value : '-'? NUMBER ;

definition : (name=NAME '=')? formula=expression ;

expression : operand ((BINDING interval? | INFIX | '-' | '/') operand)* ;

operand
    : (TEMPORAL interval? | STEP | NOT | '-')*
      ( NAME
      | NUMBER
      | TRUTH
      | '(' expression ')'
      | FUNCTION '(' expression (',' expression)* ')'
      )
    ;

// A round bracket stands only after an open end: [5,) or [5,inf).
interval : '[' bound (':' | ',') (bound (']' | ')') | ')') ;

// A number or the name of a constant; the name after it is a unit.
bound : '-'? (NUMBER | NAME | 'inf') NAME? ;

// Words come before NAME: of two rules that match the same text, ANTLR takes the first.
SPECIFICATION : 'specification' ;
FROM : 'from' ;
IMPORT : 'import' ;
CONST : 'const' ;
INPUT : 'input' ;
OUTPUT : 'output' ;
INF : 'inf' ;

// Prefix operators that take an interval.
TEMPORAL
    : 'always' | 'G' | 'alw' | 'eventually' | 'F' | 'ev'
    | 'historically' | 'H' | 'once' | 'O'
    ;

// Prefix operators that do not.
STEP : 'next' | 'X' | 's_next' | 'sX' | 'prev' | 'Y' | 's_prev' | 'sY' ;
NOT : 'not' | '!' ;

// Infix operators that take an interval.
BINDING : 'until' | 'U' | 'since' | 'S' | 'unless' | 'W' ;

// Infix operators that do not, but for '-', which is a prefix as well, and '/', which paths use.
INFIX
    : 'and' | '&' | '&&' | 'or' | '|' | '||' | 'implies' | '->' | 'iff' | '<->' | 'xor'
    | '<' | '<=' | '>' | '>=' | '==' | '!=' | '!==' | '+' | '*'
    ;
MINUS : '-' ;
SLASH : '/' ;

FUNCTION
    : 'abs' | 'sqrt' | 'exp' | 'pow' | 'ln' | 'log' | 'min' | 'max' | 'rise' | 'fall'
    ;
TRUTH : 'true' | 'false' ;

NAME : WORD ('.' WORD)* ;
NUMBER : (DIGIT+ ('.' DIGIT*)? | '.' DIGIT+) ([eE] [+-]? DIGIT+)? ;

EQUALS : '=' ;
COLON : ':' ;
COMMA : ',' ;
AT : '@' ;
OPEN : '(' ;
CLOSE : ')' ;
OPEN_INTERVAL : '[' ;
CLOSE_INTERVAL : ']' ;
END : ';' | '\n' ;

COMMENT : ('//' ~'\n'* | '/*' .*? '*/') -> skip ;
SPACE : [ \t\r\f]+ -> skip ;

// What remains is an error; the scanner reports it.
OPEN_COMMENT : '/*' ;
ILLEGAL : . ;

fragment WORD : [A-Za-z_] [A-Za-z_0-9]* ;
fragment DIGIT : [0-9] ;
